//! Groups that workers share: who waits for whom counts in every bound, and where no length is
//! stated, nothing is promised.

use replenish_plan::ledger::Ledger;
use replenish_plan::{
    Deployment, ExecutorRequest, Guarantee, Hold, Machine, Nanos, Overheads, Request, Worker, plan,
};
use replenish_sim::{Options, Policy, simulate};
use std::time::Duration;

const US: Nanos = 1_000;
const MS: Nanos = 1_000_000;

fn ms(n: u64) -> Duration {
    Duration::from_millis(n)
}

/// The arm's control loop: 1 ms, 100 times a second, within 5 ms.
fn control() -> Worker {
    let guarantee = Guarantee::at(100.0).taking(ms(1)).deadline(ms(5));
    Worker::guaranteed("control", guarantee).holding(Hold::of(0, None, "control/timer:0"))
}

/// The other one in its group, without a guarantee.
fn calibration(policy: Policy, holds: Option<Nanos>) -> Worker {
    let hold = Hold::of(0, holds, "calibration/timer:0");
    Worker::with_policy("calibration", policy).holding(hold)
}

fn request(cpus: usize, workers: &[Worker]) -> Request {
    let mut machine = Machine::with_cpus(cpus);
    machine.overheads = Overheads::NONE;
    let mut request = Request::new(machine);
    request.executor = ExecutorRequest::None;
    request.locks.push("arm".into());
    request.workers = workers.to_vec();
    request
}

fn refusal(request: &Request) -> String {
    plan(request).unwrap_err().to_string()
}

/// Defect C3. On b209253 the planner knew of no groups, and admitted it.
#[test]
fn work_of_unknown_length_in_a_group_is_refused() {
    let policies = [Policy::Other, Policy::Fifo { priority: 10 }];
    for policy in policies {
        let said = refusal(&request(1, &[control(), calibration(policy, None)]));
        assert_eq!(
            said,
            "control/timer:0 of worker \"control\" would wait in group \"arm\" for \
             calibration/timer:0 of worker \"calibration\", and nobody has stated for how long at \
             most; state it (Group::holds; in a file: holds), or take one of them out of the group"
        );
    }
    // A budget whose callbacks may be of any length is refused as well. A worker that is alone in
    // the group is not.
    let budget = Worker::guaranteed("map", Guarantee::of(ms(5)).every(ms(100)));
    let budget = budget.holding(Hold::of(0, None, "map/timer:0"));
    assert!(refusal(&request(1, &[control(), budget.clone()])).contains("for map/timer:0"));
    assert!(plan(&request(1, &[budget])).is_ok());
    // A rate has said how long its callbacks are.
    let rate = Worker::guaranteed("map", Guarantee::at(10.0).taking(ms(2)));
    let rate = rate.holding(Hold::of(0, None, "map/timer:0"));
    assert!(plan(&request(1, &[control(), rate])).is_ok());
}

#[test]
fn the_bound_of_a_guarantee_counts_the_longest_callback_of_its_group() {
    let alone = plan(&request(1, &[control()])).unwrap();
    let alone = alone.workers[0].worst_response.unwrap();
    let with = |holds| {
        plan(&request(
            1,
            &[control(), calibration(Policy::Other, Some(holds))],
        ))
    };
    for holds in [1, 500 * US, 3 * MS] {
        let admitted = with(holds).unwrap();
        let control = &admitted.workers[0];
        assert_eq!(control.worst_response, Some(alone + holds), "{holds}");
        let waits = |r: &String| r.starts_with("group \"arm\": waits up to ");
        assert!(control.reasons.iter().any(waits), "{:?}", control.reasons);
    }
    let said = with(5 * MS).unwrap_err().to_string();
    assert!(
        said.starts_with("worker \"control\" does not fit: on CPU 0 it would not be certain")
            && said.contains("(group \"arm\": waits up to 5 ms for worker \"calibration\")"),
        "{said}"
    );
}

/// A worker that inherits a priority delays all below it, members of the group or not.
#[test]
fn a_holder_delays_those_between_it_and_the_one_that_waits_for_it() {
    let between = Worker::guaranteed("between", Guarantee::at(50.0).taking(ms(2)));
    let plan_of = |holds| {
        let others = [
            control(),
            calibration(Policy::Other, holds),
            between.clone(),
        ];
        plan(&request(1, &others)).map(|p| p.workers[2].worst_response.unwrap())
    };
    let (short, long) = (plan_of(Some(1)).unwrap(), plan_of(Some(2 * MS)).unwrap());
    assert_eq!(long - short, 2 * MS - 1);
    // The one that waits need not be guaranteed itself.
    let urgent = Worker::with_policy("urgent", Policy::Fifo { priority: 95 });
    let urgent = urgent.doing(replenish_plan::Demand::new(100 * US, 10 * MS));
    let urgent = urgent.holding(Hold::of(0, Some(100 * US), ""));
    let of = |holds| {
        request(
            1,
            &[
                urgent.clone(),
                calibration(Policy::Other, holds),
                between.clone(),
            ],
        )
    };
    assert!(plan(&of(Some(MS))).is_ok());
    let said = refusal(&of(None));
    assert!(
        said.contains("worker \"calibration\" may hold group \"arm\" at a higher priority")
            && said.contains("nobody has stated"),
        "{said}"
    );
}

#[test]
fn whoever_shares_a_group_shares_a_cpu() {
    let short = || calibration(Policy::Other, Some(MS));
    let said = refusal(&request(2, &[control(), short()]));
    assert!(said.contains("from another CPU"), "{said}");
    let said = refusal(&request(2, &[control().on(0), short().on(1)]));
    assert!(said.contains("from CPUs 0 and 1"), "{said}");
    // The planner puts what it may place where the others are, over chains of groups.
    let mut all = request(2, &[control(), short().on(1)]);
    all.locks.push("gripper".into());
    let grip = Worker::guaranteed("grip", Guarantee::at(20.0).taking(ms(1)));
    all.workers[0]
        .holds
        .push(Hold::of(1, None, "control/timer:1"));
    all = all.worker(grip.holding(Hold::of(1, None, "grip/timer:0")));
    all = all.worker(Worker::guaranteed(
        "free",
        Guarantee::of(ms(10)).every(ms(100)),
    ));
    let admitted = plan(&all).unwrap();
    let cpus: Vec<_> = admitted.workers.iter().map(|w| w.cpu).collect();
    assert_eq!(cpus, [Some(1), Some(1), Some(1), Some(0)]);
    let mut unpinned = all.clone();
    unpinned.workers.remove(1);
    let admitted = plan(&unpinned).unwrap();
    assert_eq!(admitted.workers[0].cpu, admitted.workers[1].cpu);
    let deadline = Policy::Deadline {
        runtime: MS,
        deadline: 10 * MS,
        period: 10 * MS,
        reclaim: false,
    };
    let said = refusal(&request(1, &[control(), calibration(deadline, Some(MS))]));
    assert!(said.contains("SCHED_DEADLINE"), "{said}");
}

/// Waits among the workers of one program count when the next program is planned.
#[test]
fn the_next_program_finds_the_groups_of_the_first() {
    let directory = std::env::temp_dir().join(format!("replenish-groups-{}", std::process::id()));
    let ledger = Ledger::open(&directory).unwrap();
    let first = request(1, &[control(), calibration(Policy::Other, Some(3 * MS))]);
    let kept = ledger.admit(&first, "first").unwrap();
    // 1 ms and 3 ms of waiting leave 1 ms of the 5: less than it takes where waits are not counted.
    let second = |amount| {
        let urgent = Guarantee::of(Duration::from_nanos(amount))
            .every(ms(10))
            .deadline(ms(2));
        let mut request = request(1, &[Worker::guaranteed("second", urgent)]);
        request.locks.clear();
        ledger.admit(&request, "second").map(|_| ())
    };
    let said = second(1_900 * US).unwrap_err().to_string();
    assert!(said.contains("\"control\" of first"), "{said}");
    assert!(said.contains("promised its time already"), "{said}");
    second(300 * US).unwrap();
    drop(kept);
    second(1_900 * US).unwrap();
    std::fs::remove_dir_all(&directory).unwrap();
}

#[test]
fn a_file_states_how_long_locks_are_held() {
    let text = |holds: &str| {
        format!(
            "[[worker]]\nname = \"control\"\nguarantee = {{ rate = \"100 Hz\", takes = \"1 ms\", deadline = \"5 ms\" }}\n\
             locks = [{{ name = \"arm\" }}]\n\
             [[worker]]\nname = \"calibration\"\nlocks = [{{ name = \"arm\"{holds} }}]\n\
             releases = {{ every = \"50 ms\", offset = \"9500 us\" }}\nruns = \"1 ms\"\n"
        )
    };
    let read = |holds| Deployment::parse(&text(holds), "t").unwrap();
    let refused = read("").plan().unwrap_err().to_string();
    assert!(
        refused.contains("worker \"calibration\", and nobody has stated"),
        "{refused}"
    );
    let file = read(", holds = \"2 ms\"");
    let planned = file.plan().unwrap();
    let outcome = simulate(&file.system(&planned), &Options::until(5_000 * MS)).unwrap();
    assert_eq!(outcome.threads[0].misses, 0);
    assert!(outcome.threads[1].completed > 90);
    let worst = outcome.threads[0].worst().unwrap();
    assert!(worst > 2 * MS, "it has waited: {worst}");
    assert!(worst <= planned.workers[0].worst_response.unwrap());
}
