//! No simulated response exceeds its bound, in 10 000 random systems; `REPLENISH_SETS` sets
//! another number (nightly: 1000000), `REPLENISH_SEED` the first seed.

use crate::common::{Case, random_case};
use replenish_sim::analysis::{Bounds, Costs, Limit, Scheduling, Supply, bounds, describe, within};
use replenish_sim::{Options, simulate};
use replenish_testkit::sets;

#[derive(Default)]
struct Tally {
    bounded: u64,
    reserved: u64,
    unbounded: u64,
    reached: u64,
    jobs: u64,
}

impl Tally {
    fn add(&mut self, other: &Self) {
        self.bounded += other.bounded;
        self.reserved += other.reserved;
        self.unbounded += other.unbounded;
        self.reached += other.reached;
        self.jobs += other.jobs;
    }
}

/// Limits at the bounds are kept to, and one that is a little less is not.
fn yes_and_no(seed: u64, case: &Case, bounds: &[Bounds]) -> Result<(), String> {
    let exact = bounds.iter().map(|b| Limit {
        service: b.service,
        response: b.response.filter(|_| seed.is_multiple_of(2)),
    });
    let mut limits: Vec<_> = exact.collect();
    let wrong = |what, limits: &[Limit]| {
        let (tasks, costs) = (&case.tasks, &case.costs);
        format!("seed {seed}: {what} {limits:?}, {bounds:?}\n{tasks:?}\n{costs:?}")
    };
    if !within(&case.tasks, &case.costs, &limits) {
        return Err(wrong("not within", &limits));
    }
    let at = seed as usize % bounds.len();
    let less = |limit: Option<u64>| limit.map(|bound| bound - 1);
    let Limit { service, response } = limits[at];
    // Without a bound no limit is kept to.
    let (service, response) = match (service, response) {
        (None, None) => (Some(u64::MAX / 2), None),
        (service, None) => (less(service), None),
        (service, response) => (service, less(response)),
    };
    limits[at] = Limit { service, response };
    if within(&case.tasks, &case.costs, &limits) {
        return Err(wrong("within", &limits));
    }
    Ok(())
}

fn check(seed: u64, tally: &mut Tally) -> Result<(), String> {
    let case = random_case(seed);
    let bounds = bounds(&case.tasks, &case.costs);
    yes_and_no(seed, &case, &bounds)?;
    // The library finds the generator's description of a system by itself.
    if let Some(described) = describe(&case.system, 0) {
        let found: Vec<_> = described.into_iter().map(|(_, task)| task).collect();
        if found != case.tasks || Costs::of(&case.system.platform) != case.costs {
            return Err(format!(
                "seed {seed}: {found:?} instead of {:?}",
                case.tasks
            ));
        }
    }
    let outcome = simulate(&case.system, &Options::until(case.horizon).seed(seed))
        .map_err(|error| format!("seed {seed}: {error}"))?;
    for (index, (bound, thread)) in bounds.iter().zip(&outcome.threads).enumerate() {
        let task = &case.tasks[index];
        if let (Some((_, from)), Some(service), Scheduling::Reserved(params)) = (
            case.greedy.iter().find(|(greedy, _)| *greedy == index),
            bound.service,
            task.scheduling,
        ) && service <= params.period()
        {
            let budget = params.budget();
            let (overrun, slack) = (case.costs.overrun(budget), case.costs.slack(budget));
            let supply = Supply::new(&params, service, overrun, slack).map(Supply::unmerged);
            let least = supply.map_or(0, |s| s.in_window(case.horizon - from - case.costs.tick));
            if thread.cpu_high < least {
                let got = thread.cpu_high;
                return Err(format!(
                    "seed {seed}: thread {index} got {got}, at least {least} ({supply:?})\n{:?}\n{:?}",
                    case.tasks, case.system
                ));
            }
        }
        let Some(limit) = bound.response else {
            tally.unbounded += 1;
            continue;
        };
        tally.bounded += 1;
        tally.reserved += u64::from(matches!(task.scheduling, Scheduling::Reserved(_)));
        let Some(worst) = thread.worst() else {
            continue;
        };
        tally.jobs += thread.completed;
        tally.reached += u64::from(worst == limit);
        if worst > limit {
            return Err(format!(
                "seed {seed}: thread {index} took {worst}, bound {limit}\n{:?}\n{:?}",
                case.tasks, case.system
            ));
        }
    }
    Ok(())
}

#[test]
fn no_run_exceeds_its_bounds() {
    let sets = sets::wanted(10_000);
    let mut tally = Tally::default();
    let check = |seed, tally: &mut _| check(seed, tally).unwrap_or_else(|e| panic!("{e}"));
    for part in sets::each(sets, check) {
        tally.add(&part);
    }
    println!(
        "{sets} systems: {} threads bounded ({} reserved), {} without bound, {} bounds reached, {} jobs",
        tally.bounded, tally.reserved, tally.unbounded, tally.reached, tally.jobs
    );
    // The comparison means something: most threads have a bound, and many reach it.
    assert!(tally.bounded > tally.unbounded);
    assert!(tally.reserved * 10 > tally.bounded);
    assert!(tally.reached * 20 > tally.bounded);
}
