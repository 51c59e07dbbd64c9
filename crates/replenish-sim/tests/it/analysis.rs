//! The bounds against worst cases that are known, where they must be exact, and against time.

use replenish_sim::analysis::chain::{Stage, end_to_end};
use replenish_sim::analysis::{Costs, Demand, Section, Supply, Task, bounds, utilisation};
use replenish_sim::{
    Nanos, Options, Policy, Random, Releases, Span, Step, System, Thread, simulate,
};
use sporadic::{Low, Params, Tuning};

fn params(priority: u8, budget: Nanos, period: Nanos) -> Params {
    Params::new(priority, Low::Suspend, budget, period, 16).unwrap()
}

fn reserved(params: Params) -> Policy {
    Policy::Sporadic(params)
}

fn responses(tasks: &[Task]) -> Vec<Option<Nanos>> {
    let bounds = bounds(tasks, &Costs::default());
    bounds.iter().map(|bound| bound.response).collect()
}

fn worst(system: &System, horizon: Nanos) -> Vec<Nanos> {
    let outcome = simulate(system, &Options::until(horizon)).unwrap();
    outcome.threads.iter().map(|t| t.worst().unwrap()).collect()
}

#[test]
fn the_critical_instant_of_periodic_threads_reaches_the_bound() {
    // The set of Lehoczky, Sha, Ding 1989; the second has a response beyond its period (1990).
    for set in [
        [(40, 100), (40, 150), (100, 350)],
        [(26, 70), (62, 100), (0, 1000)],
    ] {
        let set: Vec<_> = set.into_iter().filter(|&(cost, _)| cost > 0).collect();
        let priority = |index: usize| 10 - index as u8;
        let tasks = set.iter().enumerate();
        let tasks: Vec<_> = tasks
            .map(|(i, &(cost, period))| Task::fifo(priority(i), Demand::new(cost, period)))
            .collect();
        let threads = set.iter().enumerate().map(|(i, &(cost, period))| {
            let policy = Policy::Fifo {
                priority: priority(i),
            };
            Thread::new("t", policy)
                .released(Releases::periodic(period))
                .runs(cost)
                .queue(100)
        });
        let simulated = worst(&System::on_one_cpu(threads.collect()), 21_000);
        let simulated: Vec<_> = simulated.into_iter().map(Some).collect();
        assert_eq!(responses(&tasks), simulated);
    }
    let textbook = [
        Task::fifo(2, Demand::new(26, 70)),
        Task::fifo(1, Demand::new(62, 100)),
    ];
    assert_eq!(responses(&textbook), [Some(26), Some(118)]);
}

#[test]
fn a_reservation_interferes_like_a_periodic_task_and_no_less() {
    let above = params(9, 30, 100);
    let tasks = [
        Task::reserved(above, None),
        Task::fifo(5, Demand::new(100, 1000)),
    ];
    let system = System::on_one_cpu(vec![
        Thread::new("above", reserved(above))
            .released(Releases::At(vec![0]))
            .runs(1_000_000),
        Thread::new("below", Policy::Fifo { priority: 5 })
            .released(Releases::periodic(1000))
            .runs(100),
    ]);
    let outcome = simulate(&system, &Options::until(10_000)).unwrap();
    assert_eq!(responses(&tasks)[1], Some(160));
    assert_eq!(outcome.threads[1].worst(), Some(160));
}

#[test]
fn inheritance_blocks_for_one_section_per_lock_and_reaches_it() {
    let mut low = Task::fifo(1, Demand::new(10, 1000));
    low.sections.push(Section { lock: 0, length: 8 });
    let mut high = Task::fifo(9, Demand::new(5, 100));
    high.sections.push(Section { lock: 0, length: 2 });
    let middle = Task::fifo(5, Demand::new(20, 500));
    let tasks = [low, middle, high];
    // high: 5 + 8; middle: 20 + 8 (low inherits) + 5.
    assert_eq!(responses(&tasks), [Some(35), Some(33), Some(13)]);
    let fifo =
        |priority, at| Thread::new("t", Policy::Fifo { priority }).released(Releases::At(vec![at]));
    let system = System {
        locks: 1,
        ..System::on_one_cpu(vec![
            fifo(1, 0)
                .then(Step::Lock(0))
                .runs(8)
                .then(Step::Unlock(0))
                .runs(2),
            fifo(5, 1).runs(20),
            fifo(9, 1)
                .then(Step::Lock(0))
                .runs(2)
                .then(Step::Unlock(0))
                .runs(3),
        ])
    };
    let simulated = worst(&system, 1000);
    // One tick of the section had passed before the others could come.
    assert_eq!(simulated[1..], [33 - 1, 13 - 1]);
}

#[test]
fn callbacks_in_a_reservation_take_whole_periods_for_whole_budgets() {
    for (cost, response) in [(30, 30), (31, 101), (60, 130), (75, 215)] {
        let params = params(9, 30, 100);
        let demand = Demand::new(cost, 1000);
        assert_eq!(
            responses(&[Task::reserved(params, Some(demand))]),
            [Some(response)]
        );
        let system = System::on_one_cpu(vec![
            Thread::new("s", reserved(params))
                .released(Releases::periodic(1000))
                .runs(cost),
        ]);
        assert_eq!(worst(&system, 5000), [response]);
    }
}

#[test]
fn the_supply_bound_is_reached_right_after_the_budget_was_used_up() {
    let params = params(9, 30, 100);
    let supply = Supply::new(&params, 30, 0, 0).unwrap().unmerged();
    assert_eq!(supply.blackout(), 70);
    let in_windows = [70, 71, 100, 101, 170, 171, 200].map(|w| supply.in_window(w));
    assert_eq!(in_windows, [0, 1, 30, 30, 30, 31, 60]);
    for cost in 1..100 {
        let window = supply.window_for(cost);
        assert!(supply.in_window(window) >= cost);
        assert!(supply.in_window(window - 1) < cost);
    }
    // 30 used from 0 to 30, the next job of 45 comes at 30: 30 at 100-130, 15 at 200-215.
    let system = System::on_one_cpu(vec![
        Thread::new("s", reserved(params))
            .released(Releases::At(vec![0, 30]))
            .runs(Span::Constant(30)),
    ]);
    assert_eq!(worst(&system, 500), [supply.window_for(30)]);
    // The periodic resource model: served as late as the period allows.
    let late = Supply::new(&params, 100, 0, 0).unwrap().unmerged();
    assert_eq!(late.blackout(), 2 * (100 - 30));
    assert_eq!(Supply::new(&params, 30, 0, 30), None);
    let merged = Supply::new(&params, 30, 0, 0).unwrap();
    assert_eq!(merged.blackout(), 100);
}

#[test]
fn what_has_no_bound_gets_none() {
    let unlimited = Task::reserved(
        Params::new(9, Low::Background(6), 30, 100, 4).unwrap(),
        None,
    );
    let tasks = [
        unlimited,
        Task::fifo(7, Demand::new(1, 100)),
        Task::fifo(5, Demand::new(1, 100)),
    ];
    // Between the two priorities the budget is the limit; below there is none.
    assert_eq!(responses(&tasks), [None, Some(31), None]);
    let overloaded = [
        Task::fifo(2, Demand::new(60, 100)),
        Task::fifo(1, Demand::new(60, 100)),
    ];
    assert_eq!(responses(&overloaded), [Some(60), None]);
    // More work than budget.
    let starved = Task::reserved(params(9, 30, 100), Some(Demand::new(40, 100)));
    assert_eq!(responses(&[starved]), [None]);
}

#[test]
fn overheads_and_lateness_count() {
    let costs = Costs {
        context_switch: 1,
        job: 2,
        release_interrupt: 1,
        tick: 10,
        ..Costs::default()
    };
    let tasks = [
        Task::fifo(9, Demand::new(5, 100)),
        Task::fifo(5, Demand::new(20, 100)),
    ];
    let bounds = bounds(&tasks, &costs);
    // A tick late, two interrupts, the job, two switches.
    assert_eq!(bounds[0].response, Some(10 + 2 + 5 + 2 + 2));
    assert_eq!(
        bounds[1].response,
        Some(10 + 2 + (5 + 2 + 2) + (20 + 2 + 2))
    );
    let share = utilisation(&tasks, &costs);
    assert!((share - (9.0 + 24.0 + 2.0) / 100.0).abs() < 1e-9, "{share}");
}

#[test]
fn utilisation_counts_the_smaller_of_budget_and_demand() {
    let demand = |cost| Some(Demand::new(cost, 100));
    let of = |task: Task| utilisation(&[task], &Costs::default());
    assert!((of(Task::reserved(params(9, 30, 100), demand(10))) - 0.1).abs() < 1e-9);
    assert!((of(Task::reserved(params(9, 30, 100), demand(80))) - 0.3).abs() < 1e-9);
    assert!((of(Task::reserved(params(9, 30, 100), None)) - 0.3).abs() < 1e-9);
}

#[test]
fn chains_add_up() {
    let event = Stage {
        response: 10,
        sampling: None,
    };
    let sampled = Stage {
        response: 20,
        sampling: Some(100),
    };
    assert_eq!(end_to_end(&[event, sampled, event]), 140);
    // A chain by events, simulated: the last stage ends within the sum after the first release.
    let fifo = |name, priority| Thread::new(name, Policy::Fifo { priority });
    let system = System::on_one_cpu(vec![
        fifo("sensor", 3)
            .released(Releases::periodic(100))
            .runs(10)
            .then(Step::Send(1)),
        fifo("control", 2).runs(20).then(Step::Send(2)),
        fifo("actuator", 1).runs(5),
    ]);
    let stages = [10, 20, 5].map(|response| Stage {
        response,
        sampling: None,
    });
    let ends = worst(&system, 1000);
    assert_eq!(ends.iter().sum::<Nanos>(), end_to_end(&stages));
}

#[test]
fn a_thousand_workers_take_less_than_a_second() {
    let mut random = Random::new(3);
    let tasks: Vec<_> = (0..1000)
        .map(|index: u32| {
            let priority = (index / 4) as u8;
            let period = random.between(1_000_000, 1_000_000_000);
            let budget = period * 9 / 10_000;
            if random.up_to(1) == 0 {
                Task::fifo(priority, Demand::new(budget, period))
            } else {
                let low = Low::Background(0);
                let params = Params::new(priority.max(1), low, budget, period, 16).unwrap();
                Task::reserved(params, Some(Demand::new(budget, period)))
            }
        })
        .collect();
    let costs = Costs {
        context_switch: 2_000,
        job: 5_000,
        release_interrupt: 1_000,
        latency: 20_000,
        tuning: Tuning {
            slack: 5_000,
            min_rearm: 0,
            max_backoff: 1_000_000,
        },
        ..Costs::default()
    };
    let start = std::time::Instant::now();
    let bounds = bounds(&tasks, &costs);
    let took = start.elapsed();
    let bounded = bounds.iter().filter(|b| b.response.is_some()).count();
    println!("{bounded} of 1000 have a bound, after {took:?}");
    assert!(bounded > 100);
    // Not a measurement: the limit is a second, and a quadratic step too many takes
    // minutes.
    assert!(took.as_secs() < 20, "{took:?}");
}
