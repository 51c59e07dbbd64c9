//! The threads of a CPU as the analysis sees them, and the parameters that a budget gets.

use super::placement::{FixedThread, PIECES, ThreadPlan};
use crate::{Machine, Nanos};
use replenish_sim::analysis::{Costs, Demand, Scheduling, Task};
use sporadic::Policy;
use sporadic::{Low, Params};

/// Replenishments of a worker with one job per period: at most two jobs begin in a period.
const PIECES_OF_JOBS: u16 = 4;

/// A task before its budget is known: for counting preemptions.
pub(super) fn skeleton(seat: &ThreadPlan, amount: Nanos, level: u8, costs: &Costs) -> Option<Task> {
    let (period, repl) = (server_period(seat, costs)?, replenishments(seat));
    let budget = amount.clamp(1, period.max(1));
    let params = Params::new(level, Low::Background(0), budget, period, repl).ok()?;
    Some(task(seat, amount, params))
}

/// The period of the budget; `None` if jobs come too irregularly for one.
fn server_period(seat: &ThreadPlan, costs: &Costs) -> Option<Nanos> {
    if !seat.per_job {
        return Some(seat.period);
    }
    // Each job has to find the budget full, however late it was raised before.
    let demand = seat.demand?;
    let late = demand.jitter.saturating_add(costs.raise_delay());
    let period = seat.period.checked_sub(late)?;
    // A wait can move the activation to the end of the job.
    let waits = demand.suspensions > 0 || !seat.sections.is_empty();
    Some(if waits { period / 2 } else { period })
}

fn replenishments(seat: &ThreadPlan) -> u16 {
    let suspensions = seat.demand.map_or(0, |d| d.suspensions);
    if seat.per_job {
        let more = u16::try_from(suspensions).unwrap_or(u16::MAX);
        PIECES_OF_JOBS.saturating_add(more).min(128)
    } else {
        PIECES
    }
}

pub(super) fn task(seat: &ThreadPlan, amount: Nanos, params: Params) -> Task {
    let demand = seat.demand.map(|d| Demand { cost: amount, ..d });
    let demand = demand.filter(|_| seat.per_job);
    Task {
        sections: seat.sections.clone(),
        ..Task::reserved(params, Some(demand.unwrap_or_else(|| pieces_of(&params))))
    }
}

/// The demand assumed where it is unknown: the whole budget, in [`PIECES`] pieces per period.
fn pieces_of(params: &Params) -> Demand {
    let pieces = Nanos::from(PIECES);
    Demand::new(
        (params.budget() / pieces).max(1),
        (params.period() / pieces).max(1),
    )
}

/// The delay that a fixed thread causes; `None`: not at all. A time-shared one does so by its
/// locks.
pub(super) fn fixed_task(fixed: &FixedThread, floor: u8) -> Option<Task> {
    let mut task = match &fixed.policy {
        Policy::Other if fixed.sections.is_empty() => return None,
        Policy::Other => Task::background(Vec::new()),
        Policy::Fifo { priority } | Policy::RoundRobin { priority } => Task {
            scheduling: Scheduling::Fifo(*priority),
            demand: fixed.demand,
            sections: Vec::new(),
        },
        Policy::Sporadic(params) | Policy::KernelSporadic(params) => {
            let below = match params.low() {
                Low::Background(low) => low < floor,
                Low::Suspend => true,
            };
            let stand_in = below.then(|| pieces_of(params));
            Task::reserved(*params, fixed.demand.or(stand_in))
        }
        // A constant-bandwidth server can give two budgets around one of its deadlines.
        Policy::Deadline {
            runtime, period, ..
        } => Task::fifo(
            u8::MAX,
            Demand {
                jitter: *period,
                ..Demand::new(*runtime, *period)
            },
        ),
    };
    task.sections.clone_from(&fixed.sections);
    Some(task)
}

/// CPU time that a job needs beyond its own to find its end in one budget: taking its message,
/// being switched to after each possible preemption, and what must be left so that the budget does
/// not count as used up.
pub(super) fn overhead(
    index: usize,
    own: &[Task],
    others: &[Task],
    seat: &ThreadPlan,
    level: u8,
    costs: &Costs,
) -> Nanos {
    let window = seat.deadline;
    let in_window =
        |period: Nanos, jitter: Nanos| window.saturating_add(jitter).div_ceil(period.max(1));
    let above = own.iter().enumerate().filter(|(at, _)| *at != index);
    let above = above.map(|(_, task)| task).chain(others);
    let preemptions = |task: &Task| {
        let waits =
            task.demand.map_or(0, |d| u64::from(d.suspensions)) + task.sections.len() as u64;
        let jobs = task.demand.map_or(0, |d| {
            in_window(d.period, d.jitter.saturating_add(d.period))
        });
        let raises = match task.scheduling {
            Scheduling::Reserved(params) => {
                let most = u64::from(params.max_repl()) + 2;
                // Raised with a lock held, it takes the CPU by inheritance as well.
                let most = most * (1 + u64::from(!task.sections.is_empty()));
                in_window(params.period(), params.period()).saturating_mul(most)
            }
            Scheduling::Fifo(_) => 0,
        };
        jobs.saturating_mul(waits + 1).saturating_add(raises)
    };
    let waits = seat.demand.map_or(0, |d| u64::from(d.suspensions)) + seat.sections.len() as u64;
    let switches = if costs.context_switch == 0 {
        0
    } else {
        let sum = above.filter(|t| t.priority() >= level).map(preemptions);
        // The holder of a lock can delay by inheritance, after each wait.
        let holders = own.iter().chain(others).any(|t| !t.sections.is_empty());
        let locks = 2 * (own.len() + others.len()) as u64 * (1 + waits);
        let locks = if holders { locks } else { 0 };
        sum.fold(2 + locks, u64::saturating_add)
    };
    let switched = switches.saturating_add(2 * (1 + waits));
    costs.job + costs.context_switch.saturating_mul(switched) + costs.slack(Nanos::MAX) + 1
}

pub(super) fn parameters(
    seat: &ThreadPlan,
    amount: Nanos,
    extra: Nanos,
    level: u8,
    machine: &Machine,
    costs: &Costs,
) -> Option<Params> {
    let period = server_period(seat, costs)?;
    let exact = amount.checked_add(extra)?;
    // Whole microseconds where there is room: reports print them in full.
    let whole = exact
        .checked_next_multiple_of(1_000)
        .filter(|b| extra > 0 && *b <= period);
    let budget = whole.unwrap_or(exact);
    let low = if seat.suspend {
        Low::Suspend
    } else if machine.is_throttled() {
        Low::Background(0)
    } else {
        let top = machine.priorities.start().saturating_sub(1).min(10);
        Low::Background(1 + (u16::from(seat.importance) * u16::from(top.max(1) - 1) / 255) as u8)
    };
    Params::new(level, low, budget, period, replenishments(seat)).ok()
}

/// The share of the CPU that is reserved.
pub(super) fn share(params: &[Params], fixed: &[&FixedThread], costs: &Costs) -> f64 {
    let ratio = |amount: Nanos, period: Nanos| amount as f64 / period.max(1) as f64;
    let reserved = |p: &Params| ratio(p.budget() + costs.enforcement, p.period());
    let given = fixed.iter().map(|f| match &f.policy {
        Policy::Other => 0.0,
        Policy::Fifo { .. } | Policy::RoundRobin { .. } => {
            f.demand.map_or(0.0, |d| ratio(d.cost, d.period))
        }
        Policy::Sporadic(params) | Policy::KernelSporadic(params) => reserved(params),
        Policy::Deadline {
            runtime, period, ..
        } => ratio(*runtime, *period),
    });
    params.iter().map(reserved).sum::<f64>() + given.sum::<f64>()
}
