//! Chains of three stages over two CPUs with other load: no run takes longer than the bound, in
//! 10 000 random systems; `REPLENISH_SETS` sets another number, `REPLENISH_SEED` the first seed.

use replenish_sim::analysis::chain::{Place, by_events};
use replenish_sim::analysis::{Costs, Demand, Task};
use replenish_sim::{
    Nanos, Options, Platform, Policy, Random, Releases, Span, Step, System, Thread, What, simulate,
};
use replenish_testkit::sets;
use sporadic::{Low, Params};

const STAGES: usize = 3;

struct Case {
    system: System,
    cpus: Vec<Vec<Task>>,
    chain: Vec<Place>,
}

fn random_case(seed: u64) -> Case {
    let r = &mut Random::new(seed);
    let mut case = Case {
        system: System {
            cpus: 2,
            locks: 0,
            platform: Platform::IDEAL,
            threads: Vec::new(),
        },
        cpus: vec![Vec::new(), Vec::new()],
        chain: Vec::new(),
    };
    let period = r.between(100, 300);
    for id in 0..STAGES + r.between(1, 4) as usize {
        let stage = id < STAGES;
        let cpu = r.up_to(1) as usize;
        let priority = r.between(2, 20) as u8;
        let period = if stage { period } else { r.between(30, 200) };
        let cost = r.between(1, period / 6);
        let demand = Demand::new(cost, period);
        let (policy, task) = if r.up_to(2) == 0 && !stage {
            let params = Params::new(priority, Low::Suspend, cost, period, 16).unwrap();
            let policy = Policy::Sporadic(params);
            (policy, Task::reserved(params, Some(demand)))
        } else {
            (Policy::Fifo { priority }, Task::fifo(priority, demand))
        };
        let min = if r.up_to(1) == 0 { cost } else { 1 };
        let mut thread = Thread::new("t", policy)
            .on(Some(cpu))
            .runs(Span::Uniform { min, max: cost })
            .queue(10_000);
        if id == 0 || !stage {
            thread.releases = Releases::Periodic {
                offset: r.up_to(20),
                period,
                jitter: 0,
            };
        }
        if id + 1 < STAGES {
            thread = thread.then(Step::Send(id + 1));
        }
        if stage {
            case.chain.push((cpu, case.cpus[cpu].len()));
        }
        case.cpus[cpu].push(task);
        case.system.threads.push(thread);
    }
    case
}

/// Bounded chains, and bounds of later stages that were reached.
type Tally = (u64, u64);

fn check(seed: u64, (bounded, reached): &mut Tally) {
    let case = random_case(seed);
    let Some(ends) = by_events(&case.cpus, &case.chain, &Costs::default()) else {
        return;
    };
    *bounded += 1;
    let outcome = simulate(&case.system, &Options::until(6_000).seed(seed).traced()).unwrap();
    let times = |thread: usize, complete: bool| -> Vec<Nanos> {
        let of = outcome.trace.iter().filter(|event| {
            event.thread == thread
                && match event.what {
                    What::Complete { .. } => complete,
                    What::Release => !complete,
                    _ => false,
                }
        });
        of.map(|event| event.time).collect()
    };
    let arrivals = times(0, false);
    for stage in 0..STAGES {
        // In order: the k-th end belongs to the k-th arrival.
        let spans = times(stage, true).into_iter().zip(&arrivals);
        let worst = spans.map(|(end, arrival)| end - arrival).max().unwrap_or(0);
        assert!(
            worst <= ends[stage],
            "seed {seed}, {stage}: {worst} of {ends:?}"
        );
        *reached += u64::from(stage > 0 && worst == ends[stage]);
    }
}

#[test]
fn no_chain_takes_longer_than_its_bound() {
    let sets = sets::wanted(10_000);
    let parts: Vec<Tally> = sets::each(sets, check);
    let bounded: u64 = parts.iter().map(|part| part.0).sum();
    let reached: u64 = parts.iter().map(|part| part.1).sum();
    println!("{sets} sets: {bounded} chains bounded, {reached} bounds of later stages reached");
    assert!(bounded * 3 > sets * 2 && reached * 30 > sets);
}
