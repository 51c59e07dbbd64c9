//! A worker's hold on its place among the enforced threads.

use super::config::Enforcement;
use super::enforced_thread::EnforcedThread;
use super::state::{EnforcedThreads, EnforcerState};
use super::usage::Usage;
use crate::backend;
use crate::backend::OsError;
use crate::backend::clock;
use crate::backend::lock_wait::LockWaits;
use crate::backend::suspend::SuspendCell;
use crate::{Arc, Nanos, Notify};
use core::sync::atomic::{AtomicBool, Ordering};
use sporadic::{BudgetServer, Level, earliest};

/// The executor stops while a worker waits for budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stopped;

#[derive(Debug)]
pub(super) struct Budgeted {
    pub(super) enforcer: Arc<EnforcerState>,
    pub(super) index: usize,
    pub(super) wake: Notify,
    pub(super) suspend: Arc<SuspendCell>,
    pub(super) cancelled: AtomicBool,
    pub(super) has_switch_records: bool,
    /// The reason why there are no records although they were asked for.
    pub(super) records_refused: Option<OsError>,
    pub(super) lock_waits: LockWaits,
}

impl Budgeted {
    /// [`Meter::usage`].
    pub(super) fn usage(&self) -> Usage {
        let mut threads = self.lock_waits.lock(&self.enforcer.threads);
        let Some(thread) = threads.enrolled.get_mut(self.index) else {
            return Usage::default();
        };
        let now = clock::monotonic();
        if thread.live {
            thread.observe(now);
        }
        let r = &thread.reservation;
        let c = r.counters();
        let usage = Usage {
            cpu_high: c.cpu_high,
            cpu_low: c.cpu_low,
            available: r.server().available(now),
            low: r.level() == Level::Low,
            exhaustions: c.exhaustions,
            replenishments: c.replenishments,
            blocked_inside: c.blocked_inside,
        };
        self.stepped(&mut threads);
        usage
    }

    pub(super) fn activate(&self, woken: Nanos) {
        self.with(|thread| thread.activate(woken, clock::monotonic()));
    }

    pub(super) fn block(&self) {
        self.with(|thread| thread.block(clock::monotonic()));
    }

    /// [`Account::callback_begin`]; keeps in `switches` how often the thread has blocked.
    pub(super) fn begin(&self, switches: &mut u64) -> Result<(), Stopped> {
        self.suspend.wait_while_suspended();
        if self.enforcer.is_deferred() {
            self.wait_for_budget()?;
        }
        if !backend::config::ALWAYS_EXACT && !self.has_switch_records {
            *switches = self.lock_waits.other_switches();
        }
        if self.cancelled.load(Ordering::Acquire) {
            return Err(Stopped);
        }
        Ok(())
    }

    /// [`Account::callback_end`].
    pub(super) fn end(&self, switches: u64) {
        if !backend::config::ALWAYS_EXACT
            && !self.has_switch_records
            && self.lock_waits.other_switches() != switches
        {
            self.with(|thread| thread.blocked_inside(clock::monotonic()));
        }
    }

    /// Runs one step on the thread under the lock, and sets the timer if the step asks for it
    /// earlier. The step changes no priority: that is the enforcer's alone.
    pub(super) fn with(&self, step: impl FnOnce(&mut EnforcedThread)) {
        let mut threads = self.lock_waits.lock(&self.enforcer.threads);
        let Some(thread) = threads.enrolled.get_mut(self.index) else {
            return;
        };
        step(thread);
        self.stepped(&mut threads);
    }

    /// The timer after a step on the thread.
    #[cfg_attr(target_os = "none", inline(never))]
    fn stepped(&self, threads: &mut EnforcedThreads) {
        let Some(thread) = threads.enrolled.get(self.index) else {
            return;
        };
        let mut at = thread.timer_at(self.enforcer.timer.as_ref());
        if !thread.reservation.is_runnable() {
            at = earliest(at, threads.pull_in(clock::monotonic()));
        }
        self.enforcer.arm(threads, at);
    }

    /// The mode without privilege: an exhausted worker waits here.
    fn wait_for_budget(&self) -> Result<(), Stopped> {
        loop {
            if self.cancelled.load(Ordering::Acquire) {
                return Err(Stopped);
            }
            let mut threads = self.lock_waits.lock(&self.enforcer.threads);
            let Some(thread) = threads.enrolled.get_mut(self.index) else {
                return Ok(());
            };
            thread.judge(clock::monotonic(), Enforcement::Deferred);
            if thread.reservation.level() == Level::High {
                return Ok(());
            }
            let due = thread.reservation.server().next_replenishment();
            drop(threads);
            if let Some(at) = due {
                self.wake.wait_until(at);
            }
        }
    }
}
