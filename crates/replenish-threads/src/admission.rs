//! Does a budget fit, beside this process's others and everything that was promised on this host?

use crate::asked::Asked;
use crate::failure::{Failure, Why};
use crate::overlay;
use replenish_os::{SchedClass, affinity, current_tid, machine_info};
use replenish_plan::ledger::{Denied, Found, Ledger, LedgerEntry, Reservation};
use replenish_plan::{
    ExecutorRequest, Machine, Nanos, Plan, Promise, Request, Requirement, Worker, plan,
};
use std::sync::OnceLock;

/// FIFO priority of every enforcer here.
pub const ENFORCER: u8 = 99;

/// A budget that fits.
#[derive(Debug)]
pub(crate) struct Admitted {
    pub(crate) cpu: usize,
    pub(crate) priority: u8,
    pub(crate) amount: Nanos,
    pub(crate) period: Nanos,
    pub(crate) background: SchedClass,
    pub(crate) worst_response: Option<Nanos>,
    /// For the next one, where there is no ledger.
    pub(crate) promises: Vec<Promise>,
    /// Its place in the ledger.
    pub(crate) place: Option<Reservation>,
}

/// Whether this process may have budgets, and its deployment file can be read.
pub(crate) fn check() -> Result<(), Failure> {
    if !replenish_os::privilege::may_be_real_time() {
        let advice = replenish_os::privilege::probe();
        return Err(Failure::new(Why::NotPermitted, advice));
    }
    overlay::file().map(|_| ())
}

/// Plans `asked`, with the deployment file's changes; `own` are the promises to budgets of this
/// process, which the ledger lists as well.
pub(crate) fn admit(asked: Asked, own: Vec<Promise>) -> Result<Admitted, Failure> {
    let asked = overlay::apply(asked)?;
    check()?;
    let mut request = request(&asked)?;
    let refused = |why: &dyn std::fmt::Display| Failure::new(Why::Refused, why);
    let ledger = |e| Failure::new(Why::System, e);
    match Ledger::find().map_err(ledger)? {
        Found::Here(directory) => {
            if let Some(measured) = directory.overheads().map_err(ledger)? {
                request.machine.overheads = measured;
            }
            match directory.admit(&request, &program()) {
                Ok(admitted) => of(
                    &asked,
                    &admitted.plan,
                    Vec::new(),
                    Some(admitted.reservation),
                ),
                Err(Denied::Refused(refusal)) => Err(refused(&refusal)),
                Err(Denied::Ledger(e)) => Err(ledger(e)),
            }
        }
        // No other program can be seen.
        Found::Off | Found::Nowhere(_) => {
            request.promised = own;
            let plan = plan(&request).map_err(|refusal| refused(&refusal))?;
            let promises = LedgerEntry::of(&request, &plan, &program()).promises(0);
            of(&asked, &plan, promises, None)
        }
    }
}

fn of(
    asked: &Asked,
    plan: &Plan,
    promises: Vec<Promise>,
    place: Option<Reservation>,
) -> Result<Admitted, Failure> {
    let unplanned = || Failure::new(Why::System, "the plan has no budget for the thread");
    let worker = plan.workers.first().ok_or_else(unplanned)?;
    let params = worker.policy.params().ok_or_else(unplanned)?;
    Ok(Admitted {
        cpu: worker.cpu.or(asked.cpu).unwrap_or(0),
        priority: params.priority(),
        amount: params.budget(),
        period: params.period(),
        background: asked.background,
        worst_response: worker.worst_response,
        promises,
        place,
    })
}

fn request(asked: &Asked) -> Result<Request, Failure> {
    let cpus = allowed();
    if let Some(cpu) = asked.cpu.filter(|cpu| !cpus.contains(cpu)) {
        return Err(Failure::invalid(format!(
            "cpu {cpu} is not allowed: this process may use {cpus:?}"
        )));
    }
    let mut machine = Machine::on_cpus(cpus.to_vec());
    let share = machine_info().real_time_share().unwrap_or(0.95);
    machine.real_time_share = share.clamp(0.01, 1.0);
    machine.enforcer_priority = ENFORCER;
    let name = asked.name.clone();
    let mut worker = match &asked.scheduling {
        Some(Requirement::Guarantee(guarantee)) => {
            guarantee.check().map_err(Failure::invalid)?;
            Worker::guaranteed(name, *guarantee)
        }
        Some(Requirement::Policy(policy)) => {
            policy.check().map_err(Failure::invalid)?;
            Worker::with_policy(name, *policy)
        }
        None => {
            let text = format!(
                "neither the program nor a deployment file (REPLENISH_OVERLAY) says a budget for \
                 {name:?}"
            );
            return Err(Failure::new(Why::NotFound, text));
        }
    };
    // Every thread of a budget is on one CPU: an expert who names none gets the last.
    worker.cpu = match asked.scheduling {
        Some(Requirement::Policy(_)) => asked.cpu.or_else(|| cpus.last().copied()),
        _ => asked.cpu,
    };
    let mut request = Request::new(machine).worker(worker);
    request.executor = ExecutorRequest::None;
    Ok(request)
}

/// The CPUs of the program, as of the first call: later a thread that asks can have a budget, and
/// then has one CPU alone.
fn allowed() -> &'static [usize] {
    static ALLOWED: OnceLock<Vec<usize>> = OnceLock::new();
    ALLOWED.get_or_init(|| {
        affinity(current_tid()).map_or_else(|_| vec![0], |set| set.iter().collect())
    })
}

/// The name by which users of other programs find this one.
fn program() -> String {
    let path = std::env::current_exe();
    path.map_or_else(|_| "a program".into(), |path| path.display().to_string())
}
