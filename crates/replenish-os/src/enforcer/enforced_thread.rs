//! One supervised thread: its reservation, and how a verdict reaches the kernel.

use super::config::{AnyServer, Enforcement, NEVER};
use super::overruns::Overruns;
use crate::Arc;
use crate::Nanos;
use crate::Tid;
use crate::backend::blocking_detector::BlockingDetector;
use crate::backend::clock::{self, ThreadCpuClock};
use crate::backend::sched::{demote_to_tail, promote};
use crate::backend::suspend::SuspendCell;
use crate::backend::timer::TimerFd;
use alloc::boxed::Box;
use sporadic::{BudgetServer, Level, Low, Reservation, Verdict};

/// The result of a judgement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum JudgeOutcome {
    Unchanged,
    Changed,
    /// The kernel refused the change of priority.
    Refused,
}

#[derive(Debug)]
pub(super) struct EnforcedThread {
    pub(super) reservation: Reservation<AnyServer>,
    pub(super) clock: ThreadCpuClock,
    pub(super) tid: Tid,
    pub(super) overruns: Box<Overruns>,
    pub(super) suspend: Arc<SuspendCell>,
    pub(super) live: bool,
    detector: BlockingDetector,
}

impl EnforcedThread {
    pub(super) fn new(
        reservation: Reservation<AnyServer>,
        tid: Tid,
        detector: BlockingDetector,
        suspend: Arc<SuspendCell>,
        overruns: Box<Overruns>,
    ) -> Self {
        Self {
            reservation,
            clock: ThreadCpuClock::of(tid),
            tid,
            overruns,
            suspend,
            live: true,
            detector,
        }
    }

    /// When the next judgement is due, [`NEVER`] if none is.
    pub(super) fn check_at(&self) -> Nanos {
        if self.live {
            self.reservation.check_at().unwrap_or(NEVER)
        } else {
            NEVER
        }
    }

    /// Whether it is to be judged now, or within `slack`.
    pub(super) fn is_due(&self, now: Nanos, slack: Nanos) -> bool {
        let at = self.check_at();
        if at == NEVER {
            return false;
        }
        let by_clock = self.detector.is_at_limit(now, slack);
        by_clock.unwrap_or(at <= now.saturating_add(slack))
    }

    /// The time for the timer; [`NEVER`] where the thread's CPU clock rings at the end of the
    /// budget, or no check is due.
    pub(super) fn timer_at(&self, timer: Option<&TimerFd>) -> Nanos {
        let at = self.check_at();
        let limit = match at {
            NEVER => None,
            _ => self.reservation.limit(),
        };
        let by_clock = self.detector.limit(timer, limit.unwrap_or(NEVER));
        // The check of a waiting thread is as good when it goes on.
        if by_clock && self.reservation.level() == Level::High {
            NEVER
        } else {
            at
        }
    }

    /// See [`Reservation::pull_in`]; the new time if it moved, otherwise [`NEVER`].
    pub(super) fn pull_in(&mut self, now: Nanos) -> Nanos {
        if self.live && self.reservation.pull_in(now) {
            self.check_at()
        } else {
            NEVER
        }
    }

    /// See [`Reservation::postpone`].
    pub(super) fn postpone(&mut self, by: Nanos) {
        if self.live {
            self.reservation.postpone(by);
        }
    }

    /// The thread's CPU clock at this moment, which is `now`.
    fn cpu(&mut self, now: Nanos) -> Nanos {
        let read = self.clock.read_at(now);
        self.or_last(read)
    }

    /// The same with the switch records up to `now`.
    fn read(&mut self, now: Nanos) -> Nanos {
        let (_, since) = self.reservation.last_reading();
        let read = self.detector.read(&self.clock, since, now);
        self.or_last(read)
    }

    /// A thread that has ended keeps its last reading.
    fn or_last(&mut self, read: Option<Nanos>) -> Nanos {
        read.unwrap_or_else(|| {
            self.live = false;
            self.reservation.last_reading().0
        })
    }

    /// The worker leaves its wait; it was woken at `woken`.
    pub(super) fn activate(&mut self, woken: Nanos, now: Nanos) {
        let read = self.detector.restart(&self.clock, now);
        let cpu = self.or_last(read);
        self.reservation.activate(woken, now, cpu);
    }

    /// The worker is about to wait.
    pub(super) fn block(&mut self, now: Nanos) {
        let cpu = self.read(now);
        self.reservation.block(now, cpu, self.detector.gaps());
    }

    /// Decides by the CPU clock, and carries the decision out.
    pub(super) fn judge(&mut self, now: Nanos, mode: Enforcement) -> JudgeOutcome {
        let late = now.saturating_sub(self.check_at());
        let cpu = if self.detector.has_not_run() {
            self.detector.skip_reading(now);
            self.reservation.last_reading().0
        } else {
            self.read(now)
        };
        let verdict = self.reservation.judge(now, cpu, self.detector.gaps());
        self.obey(verdict, now, late, mode)
    }

    /// The worker found that it blocked inside its callback, without knowing when: whatever has
    /// not been charged yet counts as activated now.
    pub(super) fn blocked_inside(&mut self, now: Nanos) {
        let cpu = self.cpu(now);
        let (_, since) = self.reservation.last_reading();
        self.detector.lost(since, now);
        self.reservation.observe(now, cpu, self.detector.gaps());
    }

    /// Brings the counters up to date without deciding anything.
    pub(super) fn observe(&mut self, now: Nanos) {
        let cpu = self.read(now);
        self.reservation.observe(now, cpu, self.detector.gaps());
    }

    /// Where the thread is at the low level, it may run at the high one again for good.
    pub(super) fn release(&mut self) {
        self.live = false;
        self.suspend.resume();
    }

    fn obey(&mut self, verdict: Verdict, now: Nanos, late: u64, mode: Enforcement) -> JudgeOutcome {
        let Some(level) = verdict.change else {
            return JudgeOutcome::Unchanged;
        };
        let params = self.reservation.server().params();
        let (high, low) = (params.priority(), params.low());
        let done = match (mode, level, low) {
            (Enforcement::Deferred, _, _) if cfg!(not(target_os = "none")) => Ok(()),
            (_, Level::Low, Low::Background(low)) => demote_to_tail(self.tid, low),
            (_, Level::High, Low::Background(_)) => promote(self.tid, high),
            (_, Level::Low, Low::Suspend) => {
                self.suspend
                    .suspend(self.tid, self.reservation.is_runnable());
                Ok(())
            }
            (_, Level::High, Low::Suspend) => {
                self.suspend.resume();
                self.detector.forget_block();
                Ok(())
            }
        };
        // Where the enforcer is on the worker's CPU, no time has passed for the worker.
        let now = match mode {
            Enforcement::SameCpu => now,
            Enforcement::OtherCpu | Enforcement::Deferred => clock::monotonic(),
        };
        let cpu = self.cpu(now);
        // A refused change is counted by the caller; the account goes on as decided, since
        // deciding the same thing again at once would help nobody.
        if let Some(overrun) = self.reservation.applied(level, now, cpu) {
            self.overruns.record(overrun, late);
        }
        if done.is_ok() {
            JudgeOutcome::Changed
        } else {
            JudgeOutcome::Refused
        }
    }
}
