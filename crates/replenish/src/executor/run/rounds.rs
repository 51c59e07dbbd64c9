//! Non-default rounds: triggers,
//! Logical Execution Time, rounds by the clock, callbacks without input, the output barrier.
//!
//! A worker reaches all this through [`Rounds`], which the methods of its builder set that give
//! such a rule. So a program that gives none does not carry the code.

use super::accounting::CpuAccounting;
use super::rules::{HandleStates, Semantics, Trigger};
use super::state::{Intake, Rounds, Worker, WorkerSpec};
use crate::Nanos;
use crate::error::Error;
use crate::event::{Event, Events};
use crate::executor::handles::entry::HandleEntry;
use crate::executor::handles::outbox::Outbox;
use crate::executor::wake::lazy_now::LazyNow;
use crate::executor::wake::schedule::{Schedule, nanos};
use crate::middleware::remedy::LARGEST;
use crate::name::concat;
use crate::platform;
use crate::platform::{displayed, text};
use crate::service::size::MEMORY;
use alloc::string::String;
use core::cell::RefCell;
use replenish_os::{Account, clock};

/// Rounds with all rules that exist.
pub(crate) static BY_RULES: Rounds = Rounds {
    check,
    outbox: |rules| {
        let (samples, bytes) = rules.barrier?;
        Some(RefCell::new(Outbox::new(samples, bytes)))
    },
    begin,
    want_all,
    step,
    next_wake,
    end,
};

fn check(worker: &WorkerSpec) -> Result<(), Error> {
    let owner = worker.request.owner();
    let rules = &worker.rules;
    let let_ = rules.semantics == Semantics::LogicalExecutionTime;
    if rules.is_unconditional() && !rules.spun {
        let allowed = "with .every(…) only: something has to start the rounds";
        return Err(Error::parameter(owner, "trigger", &"Always", allowed));
    }
    let batch = rules.batch.unwrap_or(1);
    if batch == 0 || let_ && batch > 1 {
        let allowed = if let_ {
            "1 with Logical Execution Time: a snapshot has one input per handle"
        } else {
            "1 or more"
        };
        return Err(Error::parameter(
            owner,
            "messages_per_round",
            &batch,
            allowed,
        ));
    }
    if let Some(every) = rules.every {
        if every.period.is_zero() {
            return Err(Error::parameter(owner, "every", &0, "1 ns or more"));
        }
        if every.once || !every.autostart {
            let value = if every.once { "once" } else { "not_started" };
            let allowed = "a period that begins with the executor";
            return Err(Error::parameter(owner, "every", &value, allowed));
        }
    }
    check_trigger(worker)?;
    check_barrier(worker)
}

/// A trigger that waits for one handle waits for one of the worker's, or for one that can be added.
fn check_trigger(worker: &WorkerSpec) -> Result<(), Error> {
    let Trigger::One(id) = &worker.rules.trigger else {
        return Ok(());
    };
    let mut ids = worker.entries.iter().map(|e| e.shared.id.as_str());
    if ids.any(|known| known == id) || worker.limit() > worker.entries.len() {
        return Ok(());
    }
    let mut allowed = String::from("a handle of this worker:");
    for entry in &worker.entries {
        allowed = concat(&[&allowed, " ", &entry.shared.id]);
    }
    Err(Error::parameter(
        worker.request.owner(),
        "trigger",
        id,
        allowed,
    ))
}

fn check_barrier(worker: &WorkerSpec) -> Result<(), Error> {
    let Some((samples, bytes)) = worker.rules.barrier else {
        return Ok(());
    };
    let fields = [
        ("output_barrier.samples", samples, 4096, "1..=4096"),
        ("output_barrier.bytes", bytes, LARGEST, "1..=268435456"),
    ];
    for (field, value, most, allowed) in fields {
        if !(1..=most).contains(&value) {
            let owner = worker.request.owner();
            return Err(Error::parameter(owner, field, &value, allowed));
        }
    }
    let most = MEMORY.checked_div(bytes).unwrap_or(MEMORY);
    if samples > most {
        let (owner, field) = (worker.request.owner(), "output_barrier.samples");
        let allowed = text!("1..={most} samples of {bytes} bytes, 1 GiB");
        return Err(Error::parameter(owner, field, &samples, allowed));
    }
    Ok(())
}

fn begin(worker: &mut Worker, start: Nanos) {
    if worker.spec.rules.every.is_some() {
        worker.bell.mute();
    }
    worker.grid = worker.spec.rules.every.map(|every| {
        let first = start.saturating_add(nanos(every.first_after));
        Schedule::new(first, nanos(every.period), every.overrun)
    });
}

fn want_all(worker: &Worker) -> bool {
    // The usual case: nothing to be known in advance, each handle is looked at in its turn.
    let in_turn = matches!(worker.spec.rules.trigger, Trigger::Any)
        && worker.spec.rules.semantics == Semantics::TakeThenExecute
        && !worker.spec.entries.iter().any(|e| e.handling.always);
    !in_turn
}

fn step(
    worker: &mut Worker,
    account: &mut Account,
    accounting: &CpuAccounting,
    intake: Intake<'_>,
) -> bool {
    match &mut worker.grid {
        None => round(worker, account, accounting, intake),
        Some(grid) => match grid.serve(clock::monotonic()) {
            None => false,
            Some(release) => {
                worker.spec.rules.count.note(release);
                worker.hear(Some(0));
                round(worker, account, accounting, intake);
                true
            }
        },
    }
}

/// A round, if the trigger allows it; whether it did anything.
fn round(
    worker: &mut Worker,
    account: &mut Account,
    accounting: &CpuAccounting,
    intake: Intake<'_>,
) -> bool {
    if worker.looks_at_all && !is_triggered(worker) {
        return false;
    }
    let ended = if worker.looks_at_all {
        worker.round::<true>(account, accounting, intake)
    } else {
        worker.round::<false>(account, accounting, intake)
    };
    let Ok(last) = ended else {
        return true;
    };
    if let Some(outbox) = &worker.outbox {
        let to_blame = last.and_then(|at| worker.spec.entries.get(at));
        outbox.borrow_mut().release(|e| {
            if let Some(entry) = to_blame {
                entry.shared.failed(displayed(&e), &worker.events);
            }
        });
    }
    last.is_some() || (!worker.looks_at_all && worker.run_queue.is_due())
}

/// Looks at every handle; whether what is there is enough for a round.
fn is_triggered(worker: &mut Worker) -> bool {
    let now = LazyNow::default();
    let (mut any, mut all) = (false, true);
    let spec: &mut WorkerSpec = &mut worker.spec;
    for entry in &mut spec.entries {
        entry.heard();
        entry.pull(&worker.events);
        entry.ready = entry.look(&now);
        any |= entry.ready;
        all &= entry.ready || !entry.is_live();
    }
    let states = HandleStates(&spec.entries);
    let (events, mut panicked) = (&worker.events, false);
    let is_met = match &mut spec.rules.trigger {
        Trigger::Any => any,
        Trigger::All => any && all,
        Trigger::One(id) => states.is_ready(id),
        Trigger::Always => true,
        Trigger::Custom(condition) => {
            any && platform::guard(
                condition,
                |condition| condition(&states),
                |_, message| {
                    trigger_panicked(events, &spec.request.name, message);
                    panicked = true;
                    false
                },
            )
        }
    };
    if panicked {
        replace_trigger(worker, Trigger::One(String::new())); // nothing, from now on
    }
    is_met
}

/// Gives up what was taken, and drops what the trigger owns.
fn end(worker: &mut Worker) {
    let entries = &mut worker.spec.entries;
    entries.iter_mut().for_each(HandleEntry::abandon);
    replace_trigger(worker, Trigger::Any);
}

/// Gives the worker another trigger; the closure of the old one may panic as it is dropped.
fn replace_trigger(worker: &mut Worker, trigger: Trigger) {
    let old = core::mem::replace(&mut worker.spec.rules.trigger, trigger);
    let (events, name) = (&worker.events, &worker.spec.request.name);
    platform::guard(
        &mut Some(old),
        |old| drop(old.take()),
        |_, message| trigger_panicked(events, name, message),
    );
}

fn trigger_panicked(events: &Events, worker: &str, message: &str) {
    let handle = &concat(&[worker, "/trigger"]);
    events.emit(&Event::CallbackPanicked { handle, message });
}

fn next_wake(worker: &mut Worker) -> Option<Nanos> {
    if let Some(grid) = &worker.grid {
        return Some(grid.next());
    }
    if !worker.looks_at_all {
        return worker.run_queue.earliest();
    }
    // A release that is due already waits for the trigger's other conditions, not for time.
    let overdue = match worker.spec.rules.trigger {
        Trigger::Any | Trigger::Always => 0,
        _ => clock::monotonic(),
    };
    let live = worker.spec.entries.iter_mut().filter(|e| e.is_live());
    let releases = live.filter_map(|e| e.handle.next_release());
    releases.filter(|at| *at > overdue).min()
}
