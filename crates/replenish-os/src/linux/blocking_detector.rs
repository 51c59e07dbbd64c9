//! The stretches of a callback in which its thread blocked, from the kernel's records
//! ([`ContextSwitchLog`]) where the kernel keeps them.

use super::blocked_intervals::BlockedIntervals;
use super::clock::ThreadCpuClock;
use super::config::OsError;
use super::context_switches::{ContextSwitch, ContextSwitchLog, SwitchDirection};
use super::lock_wait::LockWaits;
use super::timer::TimerFd;
use crate::Nanos;
use crate::Tid;
use sporadic::Readings;

/// A switch of a thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Switch {
    /// The thread got the CPU.
    In,
    /// The thread left the CPU and still wanted it.
    Preempted,
    /// The thread left the CPU to wait for something.
    Blocked,
}

impl Switch {
    const fn of(direction: SwitchDirection) -> Self {
        match direction {
            SwitchDirection::In => Self::In,
            SwitchDirection::Out { preempted: true } => Self::Preempted,
            SwitchDirection::Out { preempted: false } => Self::Blocked,
        }
    }
}

/// The record of one supervised thread, read by its enforcer.
#[derive(Debug)]
pub(crate) struct BlockingDetector {
    switches: Option<ContextSwitchLog>,
    intervals: BlockedIntervals,
    lock_waits: LockWaits,
}

impl BlockingDetector {
    /// Watches `tid`, one of `rings` threads that share the memory for their records. Without
    /// `exact`, or where the kernel refuses, only what [`lost`](Self::lost) tells is known. The
    /// refusal is the second value.
    pub(crate) fn new(tid: Tid, exact: bool, rings: usize) -> (Self, Option<OsError>) {
        let (switches, refused) = match exact.then(|| ContextSwitchLog::open_one_of(tid, rings)) {
            Some(Ok(log)) => (Some(log), None),
            Some(Err(e)) => (None, Some(e)),
            None => (None, None),
        };
        let detector = Self {
            switches,
            intervals: BlockedIntervals::new(),
            lock_waits: LockWaits::of(tid),
        };
        (detector, refused)
    }

    /// The thread's waits for the enforcer's lock.
    pub(crate) fn lock_waits(&self) -> LockWaits {
        self.lock_waits.clone()
    }

    /// Whether blocking inside callbacks is seen through the kernel's records.
    pub(crate) fn is_exact(&self) -> bool {
        self.switches.is_some()
    }

    /// Whether the records show that the thread has not had the CPU since the last reading; saves
    /// a system call per preempted worker and check.
    pub(crate) fn has_not_run(&self) -> bool {
        self.intervals.is_off_cpu()
            && self
                .switches
                .as_ref()
                .is_some_and(ContextSwitchLog::is_empty)
    }

    /// Whether the records up to the last reading end with the thread off the CPU.
    pub(crate) fn is_off_cpu(&self) -> bool {
        self.switches.is_some() && self.intervals.is_off_cpu()
    }

    /// A reading without records in it.
    pub(crate) fn skip_reading(&mut self, now: Nanos) {
        self.intervals.next_reading(now);
    }

    /// Reads the records from `since`, the last reading, up to `now`, and the thread's CPU clock;
    /// `None` once it has ended. Each record goes to `each`, too.
    pub(crate) fn read(
        &mut self,
        clock: &ThreadCpuClock,
        since: Nanos,
        now: Nanos,
        mut each: impl FnMut(Nanos, Switch),
    ) -> Option<Nanos> {
        self.intervals.next_reading(since);
        if let Some(log) = &mut self.switches {
            let (intervals, waits) = (&mut self.intervals, &self.lock_waits);
            let mut feed = |switch: ContextSwitch| {
                let switch = switch.unless(|at| waits.cover(at));
                each(switch.time, Switch::of(switch.kind));
                intervals.feed(switch);
            };
            if log.drain(&mut feed).lost {
                each(now, Switch::In);
                self.intervals.lost(now);
            }
        } else {
            self.intervals.lost(now);
        }
        clock.read()
    }

    /// Starts afresh with a thread that runs: what was recorded belongs to its wait.
    /// Reads its CPU clock, too. Each record goes to `each`.
    pub(crate) fn restart(
        &mut self,
        clock: &ThreadCpuClock,
        now: Nanos,
        mut each: impl FnMut(Nanos, Switch),
    ) -> Option<Nanos> {
        let cpu = clock.read();
        if let Some(log) = &mut self.switches {
            log.drain(&mut |switch| each(switch.time, Switch::of(switch.kind)));
        }
        self.intervals.restart(now);
        cpu
    }

    /// Notes that it is not known when the thread blocked.
    pub(crate) fn lost(&mut self, now: Nanos) {
        self.intervals.lost(now);
    }

    /// Linux has no cheap timer on another thread's CPU clock: the timer is set by the time.
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn limit(&self, _timer: Option<&TimerFd>, _at: Nanos) -> bool {
        false
    }

    /// See [`limit`](Self::limit).
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn is_at_limit(&self, _now: Nanos, _slack: Nanos) -> Option<bool> {
        None
    }

    /// An open block belongs to a suspension by the enforcer and does not count.
    pub(crate) fn forget_block(&mut self) {
        self.intervals.forget_block();
    }

    /// The blocking stretches of the last reading.
    pub(crate) fn readings(&self) -> Readings<'_> {
        self.intervals.readings()
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests may panic")]
    use super::*;
    use crate::backend::clock;
    use crate::current_tid;

    /// The smallest ring holds 170 switches. On b209253 the last one that fitted said "off the CPU"
    /// for ever, and no clock was read again: 611 ms at high priority with a budget of 100 ms.
    #[test]
    #[cfg_attr(miri, ignore = "has no records of switches")]
    fn a_ring_that_overflowed_is_not_believed() {
        let tid = current_tid();
        let (mut detector, refused) = BlockingDetector::new(tid, true, 128);
        assert_eq!(detector.is_exact(), refused.is_none());
        let own_clock = ThreadCpuClock::of(tid);
        // The kernel says with the next record that it has lost some.
        for (switches, fit) in [(1_000, false), (10, false), (10, true)] {
            for _ in 0..switches {
                clock::sleep_until(clock::monotonic() + 1_000);
            }
            let now = clock::monotonic();
            detector.read(&own_clock, now, now, |_, _| ()).unwrap();
            // Nor is anything known where the kernel refuses the records.
            let known = matches!(detector.readings(), Readings::Exact(_));
            assert_eq!(known, fit && refused.is_none(), "{switches} switches");
            assert!(!detector.is_off_cpu() && !detector.has_not_run());
        }
    }
}
