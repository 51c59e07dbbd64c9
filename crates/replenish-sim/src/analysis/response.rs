//! Bounds for every thread of a CPU.

use super::interference::{Interference, Locks, job_cost, raises};
use super::supply::MAX_JOBS;
use super::{Costs, Scheduling, Supply, Task};
use crate::Nanos;
use sporadic::Params;

/// The bounds that are certain of one thread.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Bounds {
    /// A reservation delivers budget that is due and asked for within this time. For a FIFO thread:
    /// the same as `response`.
    pub service: Option<Nanos>,
    /// From the arrival of a job to its end.
    pub response: Option<Nanos>,
}

/// Windows longer than this many of the longest periods are given up.
const LIMIT_PERIODS: u64 = 100;

/// Bounds for all threads of one CPU, in their order. Quadratic in their number: 1000 take a
/// fraction of a second.
///
/// The bounds hold if all other threads on this CPU are less urgent than all of `tasks` and share
/// no lock with them. A less urgent thread that shares one is a [`Task::background`].
pub fn bounds(tasks: &[Task], costs: &Costs) -> Vec<Bounds> {
    let limit = longest(tasks);
    let locks = locks(tasks, costs, limit);
    let mut result: Vec<_> = (0..tasks.len())
        .map(|index| bound(tasks, index, costs, &locks, limit))
        .collect();
    discard_unfounded(tasks, &mut result);
    result
}

/// Windows that reach this length are given up.
pub(super) fn longest(tasks: &[Task]) -> Nanos {
    let periods = tasks.iter().flat_map(|task| {
        let reservation = match task.scheduling {
            Scheduling::Reserved(params) => Some(params.period()),
            Scheduling::Fifo(_) => None,
        };
        [reservation, task.demand.map(|d| d.period)]
    });
    let longest = periods.flatten().max().unwrap_or(0);
    longest.saturating_mul(LIMIT_PERIODS)
}

/// The locks. A task is settled if its jobs end before the next one comes with no task settled.
pub(super) fn locks(tasks: &[Task], costs: &Costs, limit: Nanos) -> Locks {
    let mut locks = Locks::of(tasks);
    locks.settle(tasks, |index, locks| {
        let period = tasks[index].demand.map_or(0, |demand| demand.period);
        let response = bound(tasks, index, costs, locks, limit).response;
        response.is_some_and(|response| response <= period)
    });
    locks
}

pub(super) fn bound(
    tasks: &[Task],
    index: usize,
    costs: &Costs,
    locks: &Locks,
    limit: Nanos,
) -> Bounds {
    let Some(interference) = Interference::of(tasks, index, costs, locks) else {
        return Bounds::default();
    };
    match tasks[index].scheduling {
        Scheduling::Fifo(_) => {
            let response = fifo_response(&tasks[index], &interference, costs, limit);
            Bounds {
                service: response,
                response,
            }
        }
        Scheduling::Reserved(params) => {
            let service = service(params, &interference, costs, limit);
            Bounds {
                service,
                response: service.and_then(|service| {
                    reserved_response(&tasks[index], params, service, &interference, costs, limit)
                }),
            }
        }
    }
}

/// The budget of one period, delayed by others, after it has come back late. If that takes longer
/// than a period, what is due of the next ones waits as well: the busy period (Leh90).
fn service(
    params: Params,
    interference: &Interference,
    costs: &Costs,
    limit: Nanos,
) -> Option<Nanos> {
    let (budget, period) = (params.budget(), params.period());
    let first = interference.window(budget, 0, limit)?;
    let (mut worst, mut window) = (first, first);
    if first > period && interference.rate() + budget as f64 / period as f64 > 1.0 {
        return None;
    }
    for job in 1..=MAX_JOBS {
        let due = job * period;
        if window <= due {
            return Some(worst + costs.raise_delay());
        }
        let cost = budget.checked_mul(job + 1)?;
        window = interference.window(cost, window + budget, limit)?;
        worst = worst.max(window.saturating_sub(due));
    }
    None
}

/// Over all jobs of a busy period (Leh90), with release jitter (ABRTW93); of a thread that
/// suspends itself, suspension counted as computation, the first job only (CNH19).
fn fifo_response(
    task: &Task,
    interference: &Interference,
    costs: &Costs,
    limit: Nanos,
) -> Option<Nanos> {
    let demand = task.demand?;
    let jitter = demand.jitter + costs.tick;
    let cost = job_cost(task, costs);
    if task.suspends() {
        let own = cost + suspension(task, costs);
        let window = interference.window(own, 0, limit)?;
        return (window + jitter <= demand.period).then_some(window + jitter);
    }
    if interference.rate() + cost as f64 / demand.period as f64 > 1.0 {
        return None;
    }
    let (mut worst, mut window) = (0, 0);
    for job in 0..=MAX_JOBS {
        if job == MAX_JOBS {
            return None;
        }
        window = interference.window(cost.checked_mul(job + 1)?, window + cost, limit)?;
        // The job arrived `job` periods after the one whose full jitter opened the window.
        let arrival = job * demand.period;
        worst = worst.max((window + jitter).saturating_sub(arrival));
        if window + jitter <= arrival + demand.period {
            break;
        }
    }
    Some(worst)
}

fn suspension(task: &Task, costs: &Costs) -> Nanos {
    task.demand.map_or(0, |demand| {
        demand.suspended + u64::from(demand.suspensions) * costs.tick
    })
}

/// A job inside a reservation. Being switched to again after each preemption is paid from its
/// budget, so that cost and response depend on each other: the least fixed point.
fn reserved_response(
    task: &Task,
    params: Params,
    service: Nanos,
    interference: &Interference,
    costs: &Costs,
    limit: Nanos,
) -> Option<Nanos> {
    let mut switches = 0;
    loop {
        let cost = job_cost(task, costs) + switches * costs.context_switch;
        let job = InReservation {
            task,
            params,
            service,
            cost,
        };
        let (response, rounds) = job.response(interference, costs, limit)?;
        // To it and away from it, in each round.
        let needed = 2 * rounds + interference.switches_in(response);
        if costs.context_switch == 0 || needed <= switches {
            return Some(response);
        }
        if needed > limit {
            return None;
        }
        switches = needed;
    }
}

struct InReservation<'a> {
    task: &'a Task,
    params: Params,
    service: Nanos,
    cost: Nanos,
}

impl InReservation<'_> {
    /// The response, and in how many rounds, each with its switches.
    ///
    /// If each job finds the budget full (and can use it): q whole budgets come a period after
    /// each other, and what remains is served like a job of the reservation's priority (SSL89,
    /// SBWH10). Otherwise by the [`Supply`].
    fn response(
        &self,
        interference: &Interference,
        costs: &Costs,
        limit: Nanos,
    ) -> Option<(Nanos, u64)> {
        let (task, params) = (self.task, &self.params);
        let demand = task.demand?;
        let jitter = demand.jitter + costs.tick;
        let apart = demand.period.checked_sub(jitter)?;
        // A job that leaves more than the slack of a full budget does not exhaust it, so there is
        // no overrun for the next one to pay back.
        let (overrun, slack) = (costs.overrun(params.budget()), costs.slack(params.budget()));
        let spared = self.cost.saturating_add(slack) < params.budget();
        let held_back = if spared { 0 } else { overrun };
        let held_back = held_back + slack;
        let budget = params.budget().checked_sub(held_back).filter(|&b| b > 0)?;
        let rounds = self.cost.div_ceil(budget).max(1);
        let last_part = self.cost - (rounds - 1) * budget;
        let own = last_part + suspension(task, costs);
        let in_last = interference.window(own, 0, limit)? + costs.raise_delay();
        let before = (rounds - 1).checked_mul(params.period())?;
        let response = before + in_last;
        if task.suspends() || !task.sections.is_empty() {
            // Every wait moves the activation, at most to the end of the job.
            let full_again = response + params.period() + costs.raise_delay();
            let alone = rounds == 1 && apart >= full_again;
            return alone.then_some((jitter + response, rounds));
        }
        let full_again = before + params.period() + costs.raise_delay();
        if self.service <= params.period() && apart >= full_again {
            return Some((jitter + response, rounds));
        }
        let supply = Supply::new(params, self.service, overrun, slack)?;
        let response = supply.response(self.cost, demand.period, jitter, limit)?;
        // In whatever pieces the budget has been used before, it comes back, and each is a round.
        let pieces = response.div_ceil(params.period()) * raises(params);
        Some((response, pieces))
    }
}

/// The bounds of (CNH19) hold if each self-suspending thread above ends within its period.
fn discard_unfounded(tasks: &[Task], result: &mut [Bounds]) {
    let unfounded = tasks.iter().zip(result.iter());
    let unfounded = unfounded.filter_map(|(task, bounds)| unfounded_up_to(task, bounds));
    if let Some(highest) = unfounded.max() {
        for (task, bounds) in tasks.iter().zip(result) {
            if task.priority() <= highest {
                *bounds = Bounds::default();
            }
        }
    }
}

/// Up to which priority there is no bound because this task suspends itself and may end late.
pub(super) fn unfounded_up_to(task: &Task, bounds: &Bounds) -> Option<u8> {
    let late = task.suspends()
        && bounds
            .response
            .is_none_or(|response| task.demand.is_none_or(|demand| response > demand.period));
    // A reservation with its background priority below interferes by its budget alone.
    let reaches = match task.scheduling {
        Scheduling::Fifo(priority) => Some(priority),
        Scheduling::Reserved(_) => task.low_priority(),
    };
    reaches.filter(|_| late)
}

/// The share of the CPU that is asked for; 1.0 is all of it.
///
/// It sums jobs of FIFO threads, the smaller of budget and demand of reservations (all of their
/// demand, if they may run without budget above another thread), switches, interrupts, and the
/// enforcer.
pub fn utilisation(tasks: &[Task], costs: &Costs) -> f64 {
    let share = |cost: Nanos, period: Nanos| cost as f64 / period.max(1) as f64;
    let of = |task: &Task| {
        let interrupts = task
            .demand
            .map_or(0.0, |d| share(costs.release_interrupt, d.period));
        let demand = task.demand.map(|d| share(job_cost(task, costs), d.period));
        let own = match task.scheduling {
            Scheduling::Fifo(_) => demand.unwrap_or(1.0),
            Scheduling::Reserved(params) => {
                let budget = share(params.budget(), params.period());
                demand.unwrap_or(budget).min(budget) + share(costs.enforcement, params.period())
            }
        };
        own + interrupts
    };
    tasks.iter().map(of).sum()
}
