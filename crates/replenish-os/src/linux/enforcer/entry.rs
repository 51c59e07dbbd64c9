//! One supervised thread: its reservation, its switch log, and how a verdict reaches the kernel.

use super::gaps::GapTracker;
use super::overruns::Overruns;
use super::suspend::SuspendCell;
use super::{AnyServer, Enforcement};
use crate::Nanos;
use crate::linux::clock::{self, ThreadCpuClock};
use crate::linux::sched::{demote_to_tail, promote};
use crate::linux::switches::SwitchLog;
use crate::linux::tid::Tid;
use sporadic::{BudgetServer, Level, Low, Reservation, Verdict};
use std::sync::Arc;

/// What a judgement led to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    Unchanged,
    Changed,
    /// The kernel refused the change of priority.
    Refused,
}

#[derive(Debug)]
pub(super) struct Entry {
    pub(super) reservation: Reservation<AnyServer>,
    pub(super) clock: ThreadCpuClock,
    pub(super) tid: Tid,
    pub(super) overruns: Overruns,
    pub(super) suspend: Arc<SuspendCell>,
    pub(super) live: bool,
    switches: Option<SwitchLog>,
    gaps: GapTracker,
}

impl Entry {
    pub(super) fn new(
        reservation: Reservation<AnyServer>,
        tid: Tid,
        switches: Option<SwitchLog>,
        suspend: Arc<SuspendCell>,
    ) -> Self {
        Self {
            reservation,
            clock: ThreadCpuClock::of(tid),
            tid,
            overruns: Overruns::new(),
            suspend,
            live: true,
            switches,
            gaps: GapTracker::new(),
        }
    }

    /// When the next judgement is due, if any.
    pub(super) fn check_at(&self) -> Option<Nanos> {
        if self.live {
            self.reservation.check_at()
        } else {
            None
        }
    }

    pub(super) fn is_due(&self, now: Nanos) -> bool {
        self.check_at().is_some_and(|at| at <= now)
    }

    /// Whether blocking inside callbacks is seen through the kernel's records.
    pub(super) fn has_switch_log(&self) -> bool {
        self.switches.is_some()
    }

    /// See [`Reservation::pull_in`]; the new time if it moved.
    pub(super) fn pull_in(&mut self, now: Nanos) -> Option<Nanos> {
        if self.live && self.reservation.pull_in(now) {
            self.check_at()
        } else {
            None
        }
    }

    /// See [`Reservation::postpone`].
    pub(super) fn postpone(&mut self, by: Nanos) {
        if self.live {
            self.reservation.postpone(by);
        }
    }

    /// The thread's CPU clock; a thread that has ended keeps its last reading.
    fn cpu(&mut self) -> Nanos {
        self.clock.read().unwrap_or_else(|| {
            self.live = false;
            self.reservation.last_reading().0
        })
    }

    /// Whether the records show that the thread has not had the CPU since the last reading; saves
    /// a system call per preempted worker and check.
    fn has_not_run(&self) -> bool {
        self.gaps.is_off_cpu() && self.switches.as_ref().is_some_and(SwitchLog::is_empty)
    }

    /// Reads the switch log up to `now`.
    fn drain(&mut self, now: Nanos) {
        let (_, since) = self.reservation.last_reading();
        self.gaps.next_reading(since);
        if let Some(log) = &mut self.switches {
            let gaps = &mut self.gaps;
            if log.drain(&mut |switch| gaps.feed(switch)).lost {
                self.gaps.lost(since, now);
            }
        }
    }

    /// The worker leaves its wait; it was woken at `woken`.
    pub(super) fn activate(&mut self, woken: Nanos, now: Nanos) {
        let cpu = self.cpu();
        if let Some(log) = &mut self.switches {
            log.drain(&mut |_| {}); // switches of the wait itself
        }
        self.gaps.restart(now);
        self.reservation.activate(woken, now, cpu);
    }

    /// The worker is about to wait.
    pub(super) fn block(&mut self, now: Nanos) {
        let cpu = self.cpu();
        self.drain(now);
        self.reservation.block(now, cpu, self.gaps.gaps());
    }

    /// Decides by the CPU clock, and carries the decision out.
    pub(super) fn judge(&mut self, now: Nanos, rung: Enforcement) -> Outcome {
        let late = self.check_at().map_or(0, |at| now.saturating_sub(at));
        let cpu = if self.has_not_run() {
            self.gaps.next_reading(now);
            self.reservation.last_reading().0
        } else {
            self.drain(now);
            self.cpu()
        };
        let verdict = self.reservation.judge(now, cpu, self.gaps.gaps());
        self.obey(verdict, now, late, rung)
    }

    /// The worker found that it blocked inside its callback, without knowing when: whatever has
    /// not been charged yet counts as activated now.
    pub(super) fn blocked_inside(&mut self, now: Nanos) {
        let cpu = self.cpu();
        let (_, since) = self.reservation.last_reading();
        self.gaps.lost(since, now);
        self.reservation.observe(now, cpu, self.gaps.gaps());
    }

    /// Brings the counters up to date without deciding anything.
    pub(super) fn observe(&mut self, now: Nanos) {
        let cpu = self.cpu();
        self.drain(now);
        self.reservation.observe(now, cpu, self.gaps.gaps());
    }

    /// Where the thread is at the low level, it may run at the high one again for good.
    pub(super) fn release(&mut self) {
        self.live = false;
        self.suspend.resume();
    }

    fn obey(&mut self, verdict: Verdict, now: Nanos, late: u64, rung: Enforcement) -> Outcome {
        let Some(level) = verdict.change else {
            return Outcome::Unchanged;
        };
        let params = self.reservation.server().params();
        let (high, low) = (params.priority(), params.low());
        let done = match (rung, level, low) {
            (Enforcement::Deferred, _, _) => Ok(()),
            (_, Level::Low, Low::Background(low)) => demote_to_tail(self.tid, low),
            (_, Level::High, Low::Background(_)) => promote(self.tid, high),
            (_, Level::Low, Low::Suspend) => {
                self.suspend
                    .suspend(self.tid, self.reservation.is_runnable());
                Ok(())
            }
            (_, Level::High, Low::Suspend) => {
                self.suspend.resume();
                self.gaps.forget_block();
                Ok(())
            }
        };
        // Where the enforcer is on the worker's CPU, no time has passed for the worker.
        let now = match rung {
            Enforcement::SameCpu => now,
            Enforcement::OtherCpu | Enforcement::Deferred => clock::monotonic(),
        };
        let cpu = self.cpu();
        // A refused change is counted by the caller; the account goes on as decided, since
        // deciding the same thing again at once would help nobody.
        if let Some(overrun) = self.reservation.applied(level, now, cpu) {
            self.overruns.record(overrun, late);
        }
        if done.is_ok() {
            Outcome::Changed
        } else {
            Outcome::Refused
        }
    }
}
