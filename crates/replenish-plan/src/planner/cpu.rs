//! One CPU: its threads, their parameters, and the test whether they hold.

use super::placement::{FixedThread, ThreadPlan};
use super::priorities;
use super::tasks::{fixed_task, overhead, parameters, share, skeleton, task};
use crate::{Machine, Nanos};
use replenish_sim::analysis::{Bounds, Costs, Limit, Task, bounds, within};
use sporadic::{Params, Policy};
use std::ops::RangeInclusive;

/// The thread that misses its need, or all together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Victim {
    /// A planned thread, by its place in the list given.
    Planned(usize),
    /// A fixed thread, likewise.
    Given(usize),
    /// No single thread: too much is reserved in all.
    Sum,
}

/// Reason why a CPU does not hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Failure {
    pub(super) victim: Victim,
    /// The certain bound; `None`: there is none.
    pub(super) bound: Option<Nanos>,
    pub(super) allowed: Nanos,
}

/// A CPU with the parameters of all its threads.
#[derive(Debug, Clone, Default)]
pub(super) struct CpuPlan {
    pub(super) params: Vec<Params>,
    pub(super) bounds: Vec<Bounds>,
    pub(super) fixed: Vec<Bounds>,
    pub(super) share: f64,
    pub(super) failure: Option<Failure>,
}

/// One way to give priorities, with the parameters that follow.
struct Trial {
    plan: CpuPlan,
    /// Input of the analysis: the threads, then the fixed threads that delay one of them.
    tasks: Vec<Task>,
    floor: u8,
}

/// Chooses parameters for `threads` (each with its amount) beside `fixed`, and tests them.
pub(super) fn test(
    threads: &[(&ThreadPlan, Nanos)],
    fixed: &[&FixedThread],
    machine: &Machine,
) -> CpuPlan {
    let costs = costs(threads, fixed, machine);
    let mut first = None;
    for range in ranges(fixed, machine) {
        let trial = try_levels(threads, fixed, &range, machine, &costs);
        let plan = analysed(threads, fixed, trial, &costs);
        if plan.failure.is_none() {
            return plan;
        }
        let hopeless = plan.failure.is_some_and(|f| f.victim == Victim::Sum);
        first.get_or_insert(plan);
        if hopeless {
            break;
        }
    }
    first.unwrap_or_default()
}

/// Whether [`test()`] finds no failure, which is quicker to compute.
pub(super) fn holds(
    threads: &[(&ThreadPlan, Nanos)],
    fixed: &[&FixedThread],
    machine: &Machine,
) -> bool {
    let unbounded = |f: &&FixedThread| f.deadline.is_some() && f.policy == Policy::Other;
    if fixed.iter().any(unbounded) {
        return false;
    }
    let costs = costs(threads, fixed, machine);
    for range in ranges(fixed, machine) {
        let trial = try_levels(threads, fixed, &range, machine, &costs);
        match trial.plan.failure {
            None if within(&trial.tasks, &costs, &limits(threads, fixed, trial.floor)) => {
                return true;
            }
            Some(failure) if failure.victim == Victim::Sum => return false,
            _ => {}
        }
    }
    false
}

/// A worker that waits for the CPU is looked at again when a worker above it waits for messages, if
/// one enforcer has the budgets of all. The enforcer does not see the end of a wait inside a
/// callback.
fn costs(threads: &[(&ThreadPlan, Nanos)], fixed: &[&FixedThread], machine: &Machine) -> Costs {
    let one_enforcer = fixed
        .iter()
        .all(|f| f.own && (f.policy.params().is_some() || f.policy == Policy::Other));
    let planned = threads
        .iter()
        .any(|(t, _)| t.waits || !t.sections.is_empty());
    let mut given = fixed.iter().filter(|f| f.policy != Policy::Other);
    let given =
        given.any(|f| f.demand.is_some_and(|d| d.suspensions > 0) || !f.sections.is_empty());
    machine.overheads.costs(one_enforcer && !planned && !given)
}

/// The most other priorities for which every place between them is tried.
const PLACES: usize = 8;

/// Ranges of priorities to try: the common scale; else all above the others, or all below; else all
/// above one of the others, or all below it.
fn ranges(fixed: &[&FixedThread], machine: &Machine) -> Vec<RangeInclusive<u8>> {
    let (low, high) = (*machine.priorities.start(), *machine.priorities.end());
    let others = fixed.iter().map(|f| f.priority());
    let mut others: Vec<u8> = others.filter(|p| (low..=high).contains(p)).collect();
    others.sort_unstable();
    others.dedup();
    let above = |p: u8| (p < high).then(|| p + 1..=high);
    let below = |p: u8| (p > low).then(|| low..=p - 1);
    let mut ranges = vec![low..=high];
    ranges.extend(others.last().and_then(|p| above(*p)));
    ranges.extend(others.first().and_then(|p| below(*p)));
    if let [_, between @ ..] = others.as_slice()
        && others.len() <= PLACES
    {
        ranges.extend(between.iter().filter_map(|p| below(*p)));
        ranges.extend(others.iter().rev().skip(1).filter_map(|p| above(*p)));
    }
    ranges
}

fn levels_in(
    threads: &[(&ThreadPlan, Nanos)],
    fixed: &[&FixedThread],
    range: &RangeInclusive<u8>,
) -> Vec<u8> {
    let deadlines: Vec<Nanos> = threads.iter().map(|(s, _)| s.deadline).collect();
    let planned = threads.iter().filter(|(s, _)| s.level.is_none());
    let ordinary: Vec<Nanos> = planned.map(|(s, _)| s.deadline).collect();
    let taken: Vec<(u8, Nanos)> = fixed
        .iter()
        .map(|f| (f.priority(), f.deadline.unwrap_or(0)))
        .collect();
    let mut given = priorities::assign(&ordinary, range, &taken).into_iter();
    let level = |(seat, _): (&(&ThreadPlan, Nanos), Nanos)| match seat.0.level {
        Some(level) => level,
        None => given.next().unwrap_or(*range.start()),
    };
    threads.iter().zip(deadlines).map(level).collect()
}

/// Parameters for priorities of this range. The plan has a failure if there are none, or too much
/// would be reserved.
fn try_levels(
    threads: &[(&ThreadPlan, Nanos)],
    fixed: &[&FixedThread],
    range: &RangeInclusive<u8>,
    machine: &Machine,
    costs: &Costs,
) -> Trial {
    let levels = levels_in(threads, fixed, range);
    let floor = levels.iter().copied().min().unwrap_or(u8::MAX);
    let others: Vec<Task> = fixed.iter().filter_map(|f| fixed_task(f, floor)).collect();
    let mut trial = Trial {
        plan: CpuPlan::default(),
        tasks: Vec::with_capacity(threads.len() + others.len()),
        floor,
    };
    let fail = |victim, allowed| {
        Some(Failure {
            victim,
            bound: None,
            allowed,
        })
    };
    let pieces: Vec<Task> = threads
        .iter()
        .zip(&levels)
        .filter_map(|((seat, amount), level)| skeleton(seat, *amount, *level, costs))
        .collect();
    for (index, ((seat, amount), &level)) in threads.iter().zip(&levels).enumerate() {
        let extra = if seat.per_job {
            overhead(index, &pieces, &others, seat, level, costs)
        } else {
            0
        };
        let Some(params) = parameters(seat, *amount, extra, level, machine, costs) else {
            trial.plan.failure = fail(Victim::Planned(index), seat.deadline);
            return trial;
        };
        trial.plan.params.push(params);
        trial.tasks.push(task(seat, *amount, params));
    }
    trial.tasks.extend(others);
    trial.plan.share = share(&trial.plan.params, fixed, costs);
    if trial.plan.share > machine.real_time_share + 1e-9 {
        trial.plan.failure = fail(Victim::Sum, 0);
    }
    trial
}

/// The bounds of all threads, and the worst violation.
fn analysed(
    threads: &[(&ThreadPlan, Nanos)],
    fixed: &[&FixedThread],
    trial: Trial,
    costs: &Costs,
) -> CpuPlan {
    let Trial {
        mut plan,
        tasks,
        floor,
    } = trial;
    if plan.failure.is_some() {
        return plan;
    }
    let mut found = bounds(&tasks, costs);
    let mut rest = found.split_off(threads.len()).into_iter();
    plan.bounds = found;
    plan.fixed = fixed
        .iter()
        .map(|f| match fixed_task(f, floor) {
            Some(_) => rest.next().unwrap_or_default(),
            None => Bounds::default(),
        })
        .collect();
    plan.failure = failure(threads, fixed, &plan);
    plan
}

/// The limits that [`failure`] checks, in the order of the tasks.
fn limits(threads: &[(&ThreadPlan, Nanos)], fixed: &[&FixedThread], floor: u8) -> Vec<Limit> {
    let own = threads.iter().map(|(seat, _)| {
        let allowed = Some(seat.deadline.saturating_add(seat.late));
        if seat.per_job {
            Limit {
                response: allowed,
                ..Limit::default()
            }
        } else {
            Limit {
                service: allowed,
                ..Limit::default()
            }
        }
    });
    let delaying = fixed.iter().filter(|f| fixed_task(f, floor).is_some());
    let others = delaying.map(|f| {
        let budget = f.policy.params().is_some();
        Limit {
            service: f.deadline.filter(|_| budget),
            response: f.deadline.filter(|_| !budget || f.demand.is_some()),
        }
    });
    own.chain(others).collect()
}

/// The worst violation, in relation to what is allowed; fixed threads first.
fn failure(
    threads: &[(&ThreadPlan, Nanos)],
    fixed: &[&FixedThread],
    plan: &CpuPlan,
) -> Option<Failure> {
    let promised = fixed.iter().zip(&plan.fixed).enumerate();
    let promised = promised.filter_map(|(index, (f, bounds))| {
        let allowed = f.deadline?;
        let bound = match (f.demand, f.policy.params()) {
            (None, Some(_)) => bounds.service,
            (Some(_), Some(_)) => both(bounds),
            _ => bounds.response,
        };
        Some((Victim::Given(index), bound, allowed))
    });
    let own = threads.iter().zip(&plan.bounds).enumerate();
    let own = own.map(|(index, ((seat, _), bounds))| {
        let bound = if seat.per_job {
            bounds.response
        } else {
            bounds.service
        };
        let bound = bound.map(|b| b.saturating_sub(seat.late));
        (Victim::Planned(index), bound, seat.deadline)
    });
    let late = |(victim, bound, allowed): (Victim, Option<Nanos>, Nanos)| {
        bound.is_none_or(|b| b > allowed).then_some(Failure {
            victim,
            bound,
            allowed,
        })
    };
    if let Some(broken) = promised.filter_map(late).next() {
        return Some(broken);
    }
    let excess = |f: &Failure| match f.bound {
        None => f64::INFINITY,
        Some(bound) => bound as f64 / f.allowed.max(1) as f64,
    };
    own.filter_map(late)
        .max_by(|a, b| excess(a).total_cmp(&excess(b)))
}

fn both(bounds: &Bounds) -> Option<Nanos> {
    Some(bounds.service?.max(bounds.response?))
}
