//! The planner: from a request to a plan that holds, or a refusal.
//!
//! ```text
//!  Request ─► problem: what can be chosen, what cannot
//!                 │ minimum amounts
//!                 ▼
//!             assign: CPUs ──► cpu: levels, parameters, bounds ──► does every deadline hold?
//!                 │ yes                                               │ no
//!                 ▼                                                   ▼
//!             elastic: more, by importance                        refusal: who, why
//!                 ▼                                                   ▼
//!               Plan, with reasons                                fit: what would
//! ```

mod assign;
mod cpu;
mod elastic;
mod fit;
mod levels;
mod problem;
mod reasons;
mod refusal;
mod tasks;

pub use fit::{Changed, Fit};
pub use refusal::Refusal;

use crate::{Nanos, Request};
use assign::Placed;
use problem::{Problem, Whose};
use sporadic::Policy;

/// A schedule in which every guarantee holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The workers, in the order of the request.
    pub workers: Vec<PlannedWorker>,
    /// The executor's own thread, if it has something to do.
    pub executor: Option<PlannedExecutor>,
    /// The enforcers' priority, one on each CPU with budgets.
    pub enforcer_priority: u8,
    /// The CPUs of the request.
    pub cpus: Vec<CpuLoad>,
    /// The chains of a deployment file.
    pub chains: Vec<PlannedChain>,
    /// What limits these guarantees, in sentences.
    pub warnings: Vec<String>,
}

/// One worker.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedWorker {
    /// Its name.
    pub name: String,
    /// Its CPU; `None`: any.
    pub cpu: Option<usize>,
    /// What was chosen, or given.
    pub policy: Policy,
    /// Of what the guarantee asked for, this much is granted, in ns: of a rate, CPU time per
    /// callback; otherwise the budget.
    pub amount: Option<Nanos>,
    /// By when, in ns.
    pub deadline: Option<Nanos>,
    /// The longest time until a callback of the known demand ends or, where the demand is not
    /// known, until budget that is due is delivered, in ns. `None`: no bound.
    pub worst_response: Option<Nanos>,
    /// Why it is as it is, a sentence each.
    pub reasons: Vec<String>,
}

impl PlannedWorker {
    /// Its real-time priority while it has budget; 0 without one.
    #[must_use]
    pub fn priority(&self) -> u8 {
        self.policy.priority().unwrap_or(0)
    }

    /// From the worst response to the deadline, in ns.
    #[must_use]
    pub fn slack(&self) -> Option<Nanos> {
        self.deadline?.checked_sub(self.worst_response?)
    }
}

/// The executor's own thread.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedExecutor {
    /// Its CPU; `None`: any.
    pub cpu: Option<usize>,
    /// How it is scheduled.
    pub policy: Policy,
    /// The longest time until budget that is due is delivered, in ns.
    pub worst_response: Option<Nanos>,
    /// Why.
    pub reasons: Vec<String>,
}

/// A chain of workers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlannedChain {
    /// Its name.
    pub name: String,
    /// From the first release to the end of the last callback at worst, in ns; `None`: no bound.
    pub worst: Option<Nanos>,
    /// What is allowed, in ns.
    pub deadline: Option<Nanos>,
}

/// What is reserved of a CPU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CpuLoad {
    /// Its number.
    pub cpu: usize,
    /// The share that is reserved, 0 to 1, other programs and enforcement included.
    pub reserved: f64,
    /// The share that may be.
    pub allowed: f64,
}

/// Makes a plan: chooses CPUs, priorities, background levels, budgets and replenishments, and
/// tests every deadline with the bounds of [`replenish_sim::analysis`].
///
/// Pure and deterministic. 1000 workers take a fraction of a second.
///
/// # Errors
/// If a parameter is out of range, or a deadline or a promise to another program would not hold.
pub fn plan(request: &Request) -> Result<Plan, Refusal> {
    let problem = Problem::new(request).map_err(Refusal::invalid)?;
    let (minimum, desired) = problem.amounts();
    let all: Vec<usize> = (0..problem.seats.len()).collect();
    if desired != minimum && assign::fits(&problem, &all, &desired) {
        let placed = assign::place(&problem, &all, &desired);
        return Ok(describe(&problem, &placed, &desired));
    }
    let mut placed = assign::place(&problem, &all, &minimum);
    if placed.failure().is_some() {
        return Err(refusal::refuse(&problem, &minimum, &placed));
    }
    let mut amounts = minimum;
    if desired != amounts {
        elastic::grow(&problem, &mut placed, &mut amounts, &desired);
    }
    Ok(describe(&problem, &placed, &amounts))
}

/// Puts what was found into words.
fn describe(problem: &Problem<'_>, placed: &Placed, amounts: &[Nanos]) -> Plan {
    let request = problem.request;
    let machine = &request.machine;
    let mut plan = Plan {
        workers: request.workers.iter().map(reasons::given).collect(),
        executor: None,
        enforcer_priority: machine.enforcer_priority,
        cpus: Vec::with_capacity(machine.cpus.len()),
        chains: Vec::new(),
        warnings: Vec::new(),
    };
    let cpus = machine.cpus.iter().zip(&placed.on).zip(&placed.fixed);
    for (((&cpu, seats), fixed), found) in cpus.zip(&placed.plans) {
        plan.cpus.push(CpuLoad {
            cpu,
            reserved: found.share,
            allowed: machine.real_time_share,
        });
        for (place, &index) in seats.iter().enumerate() {
            let Some((whose, seat)) = problem.seats.get(index) else {
                continue;
            };
            let bounds = found.bounds.get(place).copied().unwrap_or_default();
            let worst = if seat.per_job {
                bounds.response
            } else {
                bounds.service
            };
            let worst = worst.map(|w| w.saturating_sub(seat.late));
            let Some(&params) = found.params.get(place) else {
                continue;
            };
            let policy = Policy::Sporadic(params);
            match whose {
                Whose::Executor => {
                    plan.executor = Some(PlannedExecutor {
                        cpu: Some(cpu),
                        policy,
                        worst_response: worst,
                        reasons: reasons::executor(seat),
                    });
                }
                Whose::Worker(worker) => {
                    let Some(planned) = plan.workers.get_mut(*worker) else {
                        continue;
                    };
                    planned.cpu = Some(cpu);
                    planned.policy = policy;
                    planned.amount = amounts.get(index).copied();
                    planned.deadline = Some(seat.deadline);
                    planned.worst_response = worst;
                    let granted = planned.amount.unwrap_or(0);
                    let asked = request
                        .workers
                        .get(*worker)
                        .and_then(crate::Worker::guarantee);
                    planned.reasons =
                        reasons::worker(seat, asked, granted, &params, machine, found.share);
                }
                Whose::Promise(_) => {}
            }
        }
        for (place, &index) in fixed.iter().enumerate() {
            let Some((whose, _, thread)) = problem.fixed.get(index) else {
                continue;
            };
            let bounds = found.fixed.get(place).copied().unwrap_or_default();
            if let Whose::Worker(worker) = whose
                && let Some(planned) = plan.workers.get_mut(*worker)
            {
                // On several CPUs: the worst of them.
                planned.worst_response = planned.worst_response.max(bounds.response);
            }
            let lowest = *machine.priorities.start();
            if machine.is_throttled() && thread.is_unlimited_above(1) && !seats.is_empty() {
                let reach = if thread.is_unlimited_above(lowest) {
                    "and delays"
                } else {
                    "but can starve"
                };
                plan.warnings
                    .push(reasons::unlimited(&problem.name(*whose), cpu, reach));
            }
        }
    }
    if let crate::ExecutorRequest::Policy { policy, cpu } = &request.executor {
        plan.executor = Some(PlannedExecutor {
            cpu: *cpu,
            policy: *policy,
            worst_response: None,
            reasons: vec!["policy given".into()],
        });
    }
    plan
}

/// The largest number between `good`, which is known to hold, and `bad`, which is known not to,
/// that holds.
fn search(mut good: u64, mut bad: u64, mut holds: impl FnMut(u64) -> bool) -> u64 {
    while bad - good > 1 {
        let middle = good + (bad - good) / 2;
        if holds(middle) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    good
}
