//! Do the budgets fit beside everything that was promised on this host? As for executors of ours,
//! and with the same ledger. The place in it is free again when this process ends, however it ends.

use super::rules::{Background, Terms};
use super::selection::Selection;
use crate::machine::cpus;
use crate::outcome::Failure;
use replenish_os::{machine_info, privilege};
use replenish_plan::ledger::{Denied, Found, Ledger, Reservation};
use replenish_plan::{ExecutorRequest, Machine, Plan, Request, Worker};
use sporadic::Policy;

/// Budgets that fit.
#[derive(Debug)]
pub(super) struct Admission {
    /// In the order in which they were asked for.
    pub(super) terms: Vec<Terms>,
    pub(super) cpu: usize,
    /// The place in the ledger, for as long as this lives.
    pub(super) reservation: Option<Reservation>,
    /// Sentences about what did not hold.
    pub(super) notes: Vec<String>,
}

/// Admits the budgets of `selection`. `usual`: the background where the plan leaves it open.
pub(super) fn admit(selection: &Selection, usual: Background) -> Result<Admission, Failure> {
    let mut request = request(selection);
    let mut notes = Vec::new();
    let mut reservation = None;
    let place = if privilege::may_be_real_time() {
        Ledger::find().map_err(Failure::refused)?
    } else {
        Found::Off // nothing gets a priority: the enforcer says so
    };
    let plan = match place {
        Found::Here(ledger) => {
            match ledger.overheads() {
                Ok(Some(measured)) => request.machine.overheads = measured,
                Ok(None) => {}
                Err(e) => notes.push(e.to_string()),
            }
            let program = format!("replenish: {}", selection.name);
            let admitted = ledger.admit(&request, &program).map_err(|e| match e {
                Denied::Refused(why) => not_admitted(selection, &why),
                Denied::Ledger(why) => not_admitted(selection, &why),
            })?;
            notes.extend(admitted.warnings);
            reservation = Some(admitted.reservation);
            admitted.plan
        }
        elsewhere => {
            if let Found::Nowhere(why) = elsewhere {
                notes.push(format!(
                    "no reservation ledger: other programs' reservations are ignored and these \
                     budgets are not published ({why})"
                ));
            }
            replenish_plan::plan(&request).map_err(|why| not_admitted(selection, &why))?
        }
    };
    notes.extend(plan.warnings.iter().cloned());
    Ok(Admission {
        terms: terms(selection, &plan, usual),
        cpu: selection.cpu,
        reservation,
        notes,
    })
}

fn not_admitted(selection: &Selection, why: &dyn std::fmt::Display) -> Failure {
    let name = &selection.name;
    Failure::refused(format!("no budgets for {name}: {why}"))
}

fn request(selection: &Selection) -> Request {
    let mut allowed = cpus::allowed();
    if !allowed.contains(&selection.cpu) {
        allowed.push(selection.cpu); // if it does not exist, the enforcer says so
    }
    let mut machine = Machine::on_cpus(allowed);
    let share = machine_info().real_time_share().unwrap_or(0.95);
    machine.real_time_share = share.clamp(0.01, 1.0);
    let worker = |(index, asked): (usize, &super::rules::Asked)| Worker {
        scheduling: asked.scheduling.clone(),
        cpu: Some(selection.cpu),
        ..Worker::with_policy(name(index, &asked.pattern), Policy::Other)
    };
    Request {
        executor: ExecutorRequest::None,
        workers: selection.asked.iter().enumerate().map(worker).collect(),
        ..Request::new(machine)
    }
}

/// A worker's name: patterns of a command line may be said twice.
fn name(index: usize, pattern: &str) -> String {
    match index {
        0 => format!("thread {pattern}"),
        _ => format!("thread {pattern} #{}", index + 1),
    }
}

fn terms(selection: &Selection, plan: &Plan, usual: Background) -> Vec<Terms> {
    let planned = selection.asked.iter().zip(&plan.workers);
    let terms = planned.filter_map(|(asked, worker)| {
        let params = worker.policy.params()?;
        Some(Terms {
            pattern: asked.pattern.clone(),
            amount: params.budget(),
            period: params.period(),
            priority: params.priority(),
            background: Background::of(params.low(), usual),
        })
    });
    terms.collect()
}
