//! Does it fit, beside everything that was promised on this host? Asked before any thread starts.
//!
//! ```text
//!   workers with a guarantee ─┐                          ┌─ yes: policies and CPUs for plan, a place
//!   workers with a policy    ─┼─► request ─► ledger ────►┤        in the ledger until the executor ends
//!   the dispatcher           ─┘    (other programs)      └─ no: Error::NotAdmitted
//! ```
//!
//! A chain that is guaranteed gets its bound from the plan, or is refused.
//!
//! The planning itself is `replenish-plan`'s; `shared_groups` says who may wait for whom,
//! `adoptions` which patterns count as workers, `chains` which bounds chains have. A program
//! without any guarantee keeps the policies it was given; it is still not let in where it would
//! break what another program was promised.

mod adoptions;
mod chains;
mod shared_groups;

use crate::error::Error;
use crate::executor::describe::executor::Options;
use crate::executor::describe::planning::{Admission, LedgerUse};
use crate::executor::run::state::WorkerSpec;
use alloc::string::{String, ToString};
use alloc::vec::Vec;
use replenish_os::{self as os, Policy};
use replenish_plan::ledger::{Denied, Found, Ledger};
use replenish_plan::{
    Demand, ExecutorRequest, GuaranteeError, Machine, Plan, Request, Requirement, Worker,
};
use shared_groups::SharedGroups;
use sporadic::Budget;

/// The dispatcher's assumed need where it has no budget and no other figure was given: a twentieth
/// of a CPU, in ns.
const DISPATCHER: (u64, u64) = (500_000, 10_000_000);

/// Plans guaranteed workers and writes into the requests what was chosen for them.
pub(crate) fn admit(workers: &mut [WorkerSpec], options: &mut Options) -> Result<Admission, Error> {
    let mut admission = Admission::default();
    adoptions::check(&options.planning.adopted)?;
    if !options.planning.admission {
        chains::admit(None, workers, &mut options.chains)?;
        return Ok(admission);
    }
    let guaranteed = workers.iter().any(|w| w.request.wants().is_some());
    let promised = guaranteed || !options.planning.adopted.is_empty();
    let expert = workers
        .iter()
        .any(|w| is_real_time(w.request.policy.as_ref()));
    if !(promised || expert || is_real_time(options.dispatcher.as_ref())) {
        chains::admit(None, workers, &mut options.chains)?;
        return Ok(admission);
    }
    let mut request = request(workers, options, guaranteed)?;
    let place = if os::privilege::may_be_real_time() {
        options.planning.ledger.find()?
    } else {
        // Nothing real-time will run: the plan promises nothing and disturbs no other program.
        Found::Off
    };
    let plan = match place {
        Found::Here(ledger) => {
            let ledger = ledger.strict(options.strict);
            match ledger.overheads() {
                Ok(Some(measured)) if options.planning.machine.is_none() => {
                    request.machine.overheads = measured;
                }
                Ok(_) => {}
                Err(e) => admission.report.notes.push(e.to_string()),
            }
            match ledger.admit(&request, &program()) {
                Ok(admitted) => {
                    admission.report.ledger = Some(ledger.directory().into());
                    admission.report.notes.extend(admitted.warnings);
                    admission.place = Some(admitted.reservation);
                    Some(admitted.plan)
                }
                Err(Denied::Refused(refusal)) => return Err(not_admitted(&refusal)),
                Err(Denied::Ledger(e)) if promised => return Err(not_admitted(&e)),
                Err(Denied::Ledger(e)) => {
                    admission.report.notes.push(e.to_string());
                    None
                }
            }
        }
        Found::Nowhere(why) if options.strict && promised => {
            return Err(Error::NotGranted {
                what: "a place in the ledger of reservations".into(),
                reason: why,
            });
        }
        elsewhere if promised => {
            if let Found::Nowhere(why) = elsewhere {
                admission.fallback = Some(alloc::format!(
                    "no reservation ledger: other programs' reservations are ignored and ours are not published ({why})"
                ));
            }
            Some(replenish_plan::plan(&request).map_err(|refusal| not_admitted(&refusal))?)
        }
        _ => None,
    };
    chains::admit(plan.as_ref(), workers, &mut options.chains)?;
    if let Some(plan) = plan {
        SharedGroups::counted(workers);
        apply(&plan, workers, options, guaranteed)?;
        adoptions::apply(&plan, &mut options.planning.adopted);
        admission.report.notes.extend(plan.warnings.iter().cloned());
        admission.report.plan = promised.then_some(plan);
    }
    Ok(admission)
}

impl LedgerUse {
    fn find(&self) -> Result<Found, Error> {
        match self {
            Self::Default => Ledger::find(),
            Self::At(directory) => Ledger::open(directory).map(Found::Here),
            Self::Off => Ok(Found::Off),
        }
        .map_err(|e| not_admitted(&e))
    }
}

fn not_admitted(reason: &dyn core::fmt::Display) -> Error {
    Error::NotAdmitted {
        reason: reason.to_string(),
    }
}

fn is_real_time(policy: Option<&Policy>) -> bool {
    policy.is_some_and(|p| *p != Policy::Other)
}

/// The name by which users of other programs find this one.
fn program() -> String {
    let path = std::env::current_exe();
    path.map_or_else(|_| "a program".into(), |p| p.display().to_string())
}

fn request(workers: &[WorkerSpec], options: &Options, guaranteed: bool) -> Result<Request, Error> {
    let mut machine = Machine::on_cpus(cpus());
    let facts = os::machine_info();
    machine.real_time_share = facts.real_time_share().unwrap_or(0.95).clamp(0.01, 1.0);
    machine.enforcer_priority = options.enforcer_priority;
    let top = options.enforcer_priority.saturating_sub(2).min(89);
    machine.priorities = 20.min(top.max(2))..=top.max(2);
    if let Some(given) = &options.planning.machine {
        machine = given.clone();
    }
    let mut request = Request::new(machine);
    let messages = workers.iter().flat_map(|w| &w.entries);
    let messages = messages.into_iter().any(|e| e.shared.input.is_some());
    request.executor = match &options.dispatcher {
        Some(policy) => ExecutorRequest::Policy {
            policy: *policy,
            cpu: options.dispatcher_cpu,
        },
        None if !messages => ExecutorRequest::None,
        None if guaranteed => ExecutorRequest::Planned {
            cpu: options.dispatcher_cpu,
        },
        None => ExecutorRequest::None,
    };
    let groups = SharedGroups::of(workers);
    request.locks = groups.names();
    let unplanned = messages && options.dispatcher.is_none() && !guaranteed;
    for spec in workers {
        let asked = &spec.request;
        let scheduling = match (asked.wants(), &asked.policy) {
            (Some(guarantee), _) => {
                guarantee.check().map_err(|e| out_of_range(asked, &e))?;
                Requirement::Guarantee(guarantee)
            }
            (None, Some(policy)) => Requirement::Policy(given(*policy, asked.budget.as_ref())),
            (None, None) if groups.matter(spec) => Requirement::Policy(Policy::Other),
            (None, None) => continue,
        };
        let worker = Worker::with_policy(&*asked.name, Policy::Other);
        request.workers.push(Worker {
            scheduling,
            cpu: asked.cpu,
            holds: groups.holds(spec),
            ..worker
        });
    }
    request
        .workers
        .extend(adoptions::workers(&options.planning.adopted));
    if unplanned {
        let (cost, period) = DISPATCHER;
        let priority = options.enforcer_priority.saturating_sub(1);
        let dispatcher = Worker::with_policy("dispatcher", Policy::Fifo { priority });
        request.workers.push(Worker {
            cpu: options.dispatcher_cpu,
            ..dispatcher.doing(Demand::new(cost, period))
        });
    }
    Ok(request)
}

fn out_of_range(asked: &crate::executor::run::request::WorkerRequest, e: &GuaranteeError) -> Error {
    match &asked.budget {
        Some(budget) if asked.guarantee.is_none() => Error::Parameter {
            owner: asked.owner(),
            field: "budget",
            value: budget.to_string(),
            allowed: e.to_string(),
        },
        _ => Error::Guarantee {
            reason: alloc::format!("{}: {e}", asked.owner()),
        },
    }
}

/// The CPUs this process may use.
fn cpus() -> Vec<usize> {
    let facts = os::machine_info();
    let mut cpus: Vec<usize> = facts.allowed.iter().collect();
    if cpus.is_empty() {
        cpus.push(0);
    }
    cpus
}

/// The executor's own plan makes a budget beside FIFO sporadic at that priority.
fn given(policy: Policy, budget: Option<&Budget>) -> Policy {
    let bounded = match (policy, budget) {
        (Policy::Fifo { priority }, Some(budget)) => {
            super::plan::sporadic(budget, priority).and_then(Result::ok)
        }
        _ => None,
    };
    bounded.unwrap_or(policy)
}

/// Writes the plan into the requests of guaranteed workers, and into the dispatcher's options.
fn apply(
    plan: &Plan,
    workers: &mut [WorkerSpec],
    options: &mut Options,
    guaranteed: bool,
) -> Result<(), Error> {
    for spec in workers.iter_mut().filter(|w| w.request.wants().is_some()) {
        let asked = &mut spec.request;
        let Some(planned) = plan.workers.iter().find(|w| *w.name == *asked.name) else {
            continue;
        };
        asked.policy = Some(planned.policy.validate()?);
        asked.cpu = planned.cpu;
        asked.budget = None;
        asked.guarantee = None;
        spec.promised = true;
    }
    if let Some(executor) = plan
        .executor
        .as_ref()
        .filter(|_| guaranteed && options.dispatcher.is_none())
    {
        options.dispatcher = Some(executor.policy.validate()?);
        options.dispatcher_cpu = executor.cpu;
    }
    Ok(())
}
