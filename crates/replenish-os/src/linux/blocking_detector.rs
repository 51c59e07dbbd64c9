//! Which stretches of a callback its thread spent blocked: from the kernel's records where it
//! keeps them ([`ContextSwitchLog`]).

use super::blocked_intervals::GapTracker;
use super::clock::ThreadCpuClock;
use super::context_switches::ContextSwitchLog;
use super::timer::TimerFd;
use crate::Nanos;
use crate::Tid;
use sporadic::Gap;

/// The record of one supervised thread, read by its enforcer.
#[derive(Debug)]
pub(crate) struct BlockingDetector {
    switches: Option<ContextSwitchLog>,
    gaps: GapTracker,
}

impl BlockingDetector {
    /// Watches `tid`; without `exact`, or where the kernel refuses, only what
    /// [`lost`](Self::lost) tells is known.
    pub(crate) fn new(tid: Tid, exact: bool) -> Self {
        let switches = if exact {
            ContextSwitchLog::open(tid).ok()
        } else {
            None
        };
        Self {
            switches,
            gaps: GapTracker::new(),
        }
    }

    /// Whether blocking inside callbacks is seen through the kernel's records.
    pub(crate) fn is_exact(&self) -> bool {
        self.switches.is_some()
    }

    /// Whether the records show that the thread has not had the CPU since the last reading; saves
    /// a system call per preempted worker and check.
    pub(crate) fn has_not_run(&self) -> bool {
        self.gaps.is_off_cpu()
            && self
                .switches
                .as_ref()
                .is_some_and(ContextSwitchLog::is_empty)
    }

    /// A reading without records in it.
    pub(crate) fn skip_reading(&mut self, now: Nanos) {
        self.gaps.next_reading(now);
    }

    /// Reads the records from `since`, the last reading, up to `now`, and the thread's CPU clock;
    /// `None` once it has ended.
    pub(crate) fn read(
        &mut self,
        clock: &ThreadCpuClock,
        since: Nanos,
        now: Nanos,
    ) -> Option<Nanos> {
        self.gaps.next_reading(since);
        if let Some(log) = &mut self.switches {
            let gaps = &mut self.gaps;
            if log.drain(&mut |switch| gaps.feed(switch)).lost {
                self.gaps.lost(since, now);
            }
        }
        clock.read()
    }

    /// Starts afresh with a thread that runs: what was recorded belongs to its wait.
    /// Reads its CPU clock, too.
    pub(crate) fn restart(&mut self, clock: &ThreadCpuClock, now: Nanos) -> Option<Nanos> {
        let cpu = clock.read();
        if let Some(log) = &mut self.switches {
            log.drain(&mut |_| {});
        }
        self.gaps.restart(now);
        cpu
    }

    /// It is not known when the thread blocked: all since the last reading counts from `now`.
    pub(crate) fn lost(&mut self, since: Nanos, now: Nanos) {
        self.gaps.lost(since, now);
    }

    /// There is no cheap way to be told of a CPU clock: the timer is set by the time.
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
        self.gaps.forget_block();
    }

    /// The blocking stretches of the last reading.
    pub(crate) fn gaps(&self) -> &[Gap] {
        self.gaps.gaps()
    }
}
