//! One supervised thread: its reservation, and the way of a verdict to the kernel.

use super::config::{AnyServer, Enforcement, NEVER};
use super::overruns::Overruns;
use super::supervised::Supervised;
use crate::Arc;
use crate::Nanos;
use crate::Tid;
use crate::backend::blocking_detector::BlockingDetector;
use crate::backend::clock::{self, ThreadCpuClock};
use crate::backend::sched::{self, demote_to_tail, promote};
use crate::backend::suspend::SuspendCell;
use crate::backend::timer::TimerFd;
use alloc::boxed::Box;
use sporadic::{BudgetServer, Level, Low, Reservation, Verdict, later, since};

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
    /// CPU time that it had used at the last reading while others waited for it.
    inherited: Nanos,
    /// It was found with a priority that nobody gave it: its low time up to the next reading is a
    /// debt.
    pub(super) escaped: bool,
    pub(super) supervised: Supervised,
}

impl EnforcedThread {
    pub(super) fn new(
        reservation: Reservation<AnyServer>,
        tid: Tid,
        detector: BlockingDetector,
        suspend: Arc<SuspendCell>,
        overruns: Box<Overruns>,
    ) -> Self {
        let supervised = Supervised::of(tid, reservation.server().params());
        Self {
            supervised,
            reservation,
            clock: ThreadCpuClock::of(tid),
            tid,
            overruns,
            suspend,
            live: true,
            detector,
            inherited: 0,
            escaped: false,
        }
    }

    /// Time at which the next judgement is due, [`NEVER`] if none is.
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
        by_clock.unwrap_or(at <= later(now, slack))
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

    /// Whether it has budget, and has not had the CPU since its last reading: all of it is left.
    pub(super) fn waits_funded(&self, now: Nanos) -> bool {
        self.reservation.level() == Level::High
            && self.detector.has_not_run()
            && self.reservation.server().available(now) > 0
    }

    /// A thread that has not had the CPU since its last reading still has all of its budget: its
    /// check counts from now. Otherwise the checks of all threads that wait for one CPU would come
    /// when the first of them is through, and each would find the next one short of its end by what
    /// the earlier ones took too long.
    pub(super) fn catch_up(&mut self, now: Nanos) {
        let at = self.check_at();
        if at == NEVER || self.reservation.level() == Level::Low || !self.detector.has_not_run() {
            return;
        }
        let left = self.reservation.server().available(now);
        if left > 0 {
            let due = later(now, left);
            self.reservation.postpone(since(due, at));
        }
    }

    /// See [`Reservation::postpone`].
    pub(super) fn postpone(&mut self, by: Nanos) {
        if self.live {
            self.reservation.postpone(by);
        }
    }

    /// The thread's CPU clock at this moment, which is `now`.
    pub(super) fn cpu(&mut self, now: Nanos) -> Nanos {
        let read = self.clock.read_at(now);
        self.or_last(read, now)
    }

    /// The same with the switch records up to `now`.
    fn read(&mut self, now: Nanos) -> Nanos {
        let (_, since) = self.reservation.last_reading();
        let switches = self.supervised.switches();
        let read = self.detector.read(&self.clock, since, now, switches);
        self.notice_escape(read);
        self.or_last(read, now)
    }

    /// A worker that gave itself a priority while it has no budget. After the reading it is too
    /// late: what it used is accounted as low.
    fn notice_escape(&mut self, read: Option<Nanos>) {
        let low = self.reservation.server().params().low();
        if self.reservation.level() == Level::Low
            && matches!(low, Low::Background(_)) // all that a suspended one uses is a debt
            && read.is_some_and(|cpu| cpu > self.reservation.last_reading().0)
        {
            self.escaped |= self.supervised.is_above_its_own();
        }
    }

    /// A thread that has ended keeps its last reading.
    fn or_last(&mut self, read: Option<Nanos>, now: Nanos) -> Nanos {
        let Some(cpu) = read else {
            self.end();
            return self.reservation.last_reading().0;
        };
        self.charge_low(cpu, now);
        cpu
    }

    /// Low time is free unless the thread was to stand still (it ran on in a critical section), or
    /// had it at a priority that it inherited or gave itself: that is a debt. `cpu` is the reading
    /// that the reservation is about to get.
    fn charge_low(&mut self, cpu: Nanos, now: Nanos) {
        if cfg!(target_os = "none") {
            return; // 100 bytes of flash; a suspended task there is behind every other one
        }
        let sum = self.suspend.inherited(cpu);
        // The sum may seem to fall for the moment in which the thread adds to it.
        let inherited = since(sum, self.inherited);
        self.inherited = self.inherited.max(sum);
        let escaped = core::mem::take(&mut self.escaped);
        if self.reservation.level() == Level::High {
            return;
        }
        let used = since(cpu, self.reservation.last_reading().0);
        let owed = match self.reservation.server().params().low() {
            Low::Suspend => used,
            Low::Background(_) if escaped => used,
            Low::Background(_) => inherited.min(used),
        };
        if owed > 0 {
            self.reservation.owe(owed, now);
        }
    }

    /// The worker leaves its wait; it was woken at `woken`.
    pub(super) fn activate(&mut self, woken: Nanos, now: Nanos) {
        let switches = self.supervised.switches();
        let read = self.detector.restart(&self.clock, now, switches);
        self.notice_escape(read);
        let cpu = self.or_last(read, now);
        self.reservation.activate(woken, now, cpu);
        self.supervised.turned(&self.reservation, now, true);
    }

    /// The worker is about to wait.
    pub(super) fn block(&mut self, now: Nanos) {
        let cpu = self.read(now);
        self.reservation.block(now, cpu, self.detector.readings());
        self.supervised.turned(&self.reservation, now, false);
    }

    /// Decides by the CPU clock, and carries the decision out.
    pub(super) fn judge(&mut self, now: Nanos, mode: Enforcement) -> JudgeOutcome {
        let late = since(now, self.check_at());
        let cpu = if self.detector.has_not_run() {
            self.detector.skip_reading(now);
            self.reservation.last_reading().0
        } else {
            self.read(now)
        };
        let verdict = self.reservation.judge(now, cpu, self.detector.readings());
        self.obey(verdict, now, late, mode)
    }

    /// The worker found that it blocked inside its callback, without knowing when.
    pub(super) fn blocked_inside(&mut self, now: Nanos) {
        let cpu = self.cpu(now);
        self.detector.lost(now);
        self.reservation.observe(now, cpu, self.detector.readings());
        self.supervised.observed(&self.reservation, now, true);
    }

    /// Brings the counters up to date without deciding anything.
    pub(super) fn observe(&mut self, now: Nanos) {
        let cpu = self.read(now);
        self.reservation.observe(now, cpu, self.detector.readings());
        self.supervised.observed(&self.reservation, now, false);
    }

    /// Ends the enforcement: a suspended thread runs again, and is stopped no more.
    pub(super) fn release(&mut self) {
        self.end();
        self.suspend.resume();
    }

    /// It is judged no more.
    fn end(&mut self) {
        self.live = false;
        self.supervised.end();
    }

    /// The last change was refused, and the level in force is the right one by now.
    fn settle_refusal(&mut self, high: u8, low: Low) {
        match (self.reservation.level(), low) {
            // Funded again, it must not lower itself any more. If it is about to, the watchdog
            // restores it.
            (Level::High, _) => {
                self.suspend.resume();
                self.supervised.note(Some(high), true);
            }
            // The thread was let go, and has used its budget in the time-sharing class.
            (Level::Low, Low::Suspend) => {
                let runs = self.reservation.is_runnable();
                self.suspend.suspend(self.tid, runs).ok(); // it is there already
            }
            (Level::Low, Low::Background(_)) => {}
        }
    }

    pub(super) fn obey(
        &mut self,
        verdict: Verdict,
        now: Nanos,
        late: u64,
        mode: Enforcement,
    ) -> JudgeOutcome {
        let params = self.reservation.server().params();
        let (high, low) = (params.priority(), params.low());
        let Some(level) = verdict.change else {
            if self.supervised.is_refused() {
                self.settle_refusal(high, low);
            }
            return JudgeOutcome::Unchanged;
        };
        let done = match (mode, level, low) {
            (Enforcement::Deferred, _, _) if cfg!(not(target_os = "none")) => Ok(()),
            (_, Level::Low, Low::Background(low)) => {
                self.suspend
                    .lower(self.inherited.saturating_add(params.budget()));
                let lowered = demote_to_tail(self.tid, low);
                if lowered.is_err() && !sched::has_level(self.tid, high, level) {
                    self.suspend.resume(); // it is high, and nothing that it inherits stops it
                    self.suspend.lower_itself(self.tid, low);
                }
                lowered
            }
            (_, Level::High, Low::Background(_)) => {
                let raised = promote(self.tid, high);
                self.suspend.resume(); // from the stop after too much inherited time
                if raised.is_err() && !sched::has_level(self.tid, high, level) {
                    // Low for another period: what it inherits in it is bounded as well.
                    self.suspend
                        .lower(self.inherited.saturating_add(params.budget()));
                }
                raised
            }
            (_, Level::Low, Low::Suspend) => self
                .suspend
                .suspend(self.tid, self.reservation.is_runnable()),
            (_, Level::High, Low::Suspend) => {
                if self.suspend.is_stopped() {
                    self.detector.forget_block();
                }
                let raised = self.suspend.resume_at(self.tid, high);
                // A small kernel refuses no priority, and its flash is short.
                let refused = cfg!(not(target_os = "none")) && raised.is_err();
                if refused && !sched::has_level(self.tid, high, level) {
                    // The thread goes on in the time-sharing class, for its budget and no longer.
                    self.suspend
                        .lower(self.inherited.saturating_add(params.budget()));
                }
                raised
            }
        };
        // With the enforcer on the worker's CPU, no time has passed for the worker. Its clock
        // stands still if it was preempted there, as it should be.
        let (now, cpu) = match mode {
            Enforcement::SameCpu if self.detector.is_off_cpu() => {
                (now, self.reservation.last_reading().0)
            }
            Enforcement::SameCpu => (now, self.cpu(now)),
            Enforcement::OtherCpu | Enforcement::Deferred => {
                let now = clock::monotonic();
                (now, self.cpu(now))
            }
        };
        // A thread that stops needs no priority for that: refused, it is low all the same.
        let stops = level == Level::Low && low == Low::Suspend;
        let obeyed = done.is_ok() || stops || sched::has_level(self.tid, high, level);
        let low = if let Low::Background(low) = low {
            low
        } else {
            0
        };
        let given = if level == Level::High { high } else { low };
        self.supervised.note(done.is_ok().then_some(given), obeyed);
        if !obeyed {
            // The thread has the level that it had, and the account says so.
            self.reservation.refused(now);
            return JudgeOutcome::Refused;
        }
        if let Some(overrun) = self.reservation.applied(level, now, cpu) {
            self.overruns.record(overrun, late);
        }
        self.supervised.applied(&self.reservation, now, level, late);
        if done.is_ok() {
            JudgeOutcome::Changed
        } else {
            JudgeOutcome::Refused
        }
    }
}

#[cfg(all(test, target_os = "linux", not(nuttx_host), not(loom)))]
mod tests;
