//! Requests that the kernel refused, and the fallbacks that are declared for them.

use super::threads::ThreadPlan;
use crate::error::Error;
use crate::event::{Event, Events};
use crate::platform::{BARE, STD, Text, join, text};
use alloc::vec::Vec;
use replenish_os::{self as os, Enforcer};

/// Requests that are not in force.
#[derive(Default)]
pub(super) struct Refused {
    /// A refusal is an error.
    pub(super) strict: bool,
    pub(super) memory: Option<Text>,
    /// Threads without their policy.
    pub(super) policies: Vec<Text>,
    /// Threads whose budget has no enforcer.
    pub(super) budgets: Vec<Text>,
    /// Threads whose blocking the kernel does not record.
    pub(super) records: Vec<Text>,
    /// Reason of the first thread that is not recorded.
    pub(super) unrecorded: Option<Text>,
    /// The fallback of enforcers without a watchdog, of the first.
    pub(super) watchdog: Option<Text>,
    /// The kernel's first refusal, with the way to have the request granted.
    pub(super) why: Option<Text>,
}

impl Refused {
    /// Locks the memory, or takes note that it is not locked.
    pub(super) fn lock_memory(&mut self) -> Result<(), Error> {
        match os::memory::lock_all() {
            Err(e) if self.strict => Err(Error::NotGranted {
                what: "locked memory".into(),
                reason: text!("{e}"),
            }),
            Err(e) => {
                self.memory = Some(text!("memory is not locked: {e}"));
                Ok(())
            }
            Ok(()) => Ok(()),
        }
    }

    /// Takes note of an enforcer without a watchdog.
    pub(super) fn supervised(&mut self, enforcer: &Enforcer) -> Result<(), Error> {
        let Some(e) = enforcer.watchdog_refused() else {
            return Ok(());
        };
        if self.strict {
            return Err(Error::NotGranted {
                what: "a watchdog for the enforcer".into(),
                reason: text!("{e}"),
            });
        }
        let unwatched = || text!("nobody notices if an enforcer fails: its watchdog: {e}");
        self.watchdog.get_or_insert_with(unwatched);
        Ok(())
    }

    /// Takes note of a refusal that may be lived with; otherwise it is the error.
    pub(super) fn refuse(&mut self, plan: &ThreadPlan, e: &os::SpawnError) -> Result<(), Error> {
        if !e.is_permission() {
            return Err(thread_error(plan, text!("{e}")));
        }
        if self.strict {
            return Err(Error::NotGranted {
                what: text!("{} for {:?}", plan.policy, &*plan.name),
                reason: text!("{e}"),
            });
        }
        self.why.get_or_insert_with(|| text!("{e}"));
        Ok(())
    }

    /// Takes note of a budgeted thread without the kernel's records of its blocking.
    pub(super) fn records(&mut self, plan: &ThreadPlan, meter: &os::Meter) -> Result<(), Error> {
        if !STD {
            return Ok(()); // small kernels' hooks see every switch
        }
        let Some(e) = meter.records_refused() else {
            return Ok(());
        };
        let reason = text!(
            "context-switch records: {e}. They need kernel.perf_event_paranoid of 2 at most, a \
             descriptor each (ulimit -n), and locked memory (kernel.perf_event_mlock_kb, ulimit -l)"
        );
        if self.strict {
            return Err(Error::NotGranted {
                what: text!("exact account of blocking for {:?}", &*plan.name),
                reason,
            });
        }
        self.records.push(Text::from(&*plan.name));
        self.unrecorded.get_or_insert(reason);
        Ok(())
    }

    /// Declares the refused guarantees once.
    pub(super) fn declare(&mut self, unseen: [Option<Text>; 3], events: &Events) -> Vec<Text> {
        if BARE {
            return Vec::new(); // nothing was refused
        }
        let refused = core::mem::take(self);
        let mut fallbacks: Vec<Text> = {
            let unseen = unseen.into_iter().flatten();
            let missing = refused.memory.into_iter().chain(refused.watchdog);
            missing.chain(unseen).collect()
        };
        if let Some(why) = refused.why {
            let mut parts = Vec::new();
            if !refused.policies.is_empty() {
                let who = join(&refused.policies, ", ");
                parts.push(text!("time-shared instead of real-time: {who}"));
            }
            if !refused.budgets.is_empty() {
                let who = join(&refused.budgets, ", ");
                parts.push(text!("budgets held at callback boundaries only: {who}"));
            }
            fallbacks.push(text!("{}. {why}", join(&parts, "; ")));
        }
        if let Some(why) = refused.unrecorded {
            let who = join(&refused.records, ", ");
            fallbacks.push(text!(
                "budgets come back late if callbacks block or are preempted: {who}. {why}"
            ));
        }
        for message in &fallbacks {
            events.emit(&Event::Fallback { message });
        }
        fallbacks
    }
}

/// The error of a thread that cannot be started.
pub(super) fn thread_error(plan: &ThreadPlan, reason: Text) -> Error {
    Error::Thread {
        name: Text::from(&*plan.name),
        reason,
    }
}
