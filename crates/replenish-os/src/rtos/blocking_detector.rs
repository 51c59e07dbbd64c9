//! The stretches of a callback in which its task blocked, from the switch hooks.

use super::blocked_intervals::BlockedIntervals;
use super::clock::ThreadCpuClock;
use super::error::OsError;
use super::lock_wait::LockWaits;
use super::timer::TimerFd;
use crate::Nanos;
use crate::Tid;
use crate::backend::port::alarm;
use crate::backend::port::task_slot::{self, TaskSlot, TaskState};
use sporadic::Readings;

/// A switch of a task; the hooks keep no list of them.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Switch {}

/// The record of one supervised task, read by its enforcer.
#[derive(Debug)]
pub(crate) struct BlockingDetector {
    slot: Option<&'static TaskSlot>,
    read: BlockedIntervals,
}

impl BlockingDetector {
    /// No record is refused here.
    pub(crate) fn new(tid: Tid, _exact: bool, _rings: usize) -> (Self, Option<OsError>) {
        let detector = Self {
            slot: task_slot::find(tid.get()),
            read: BlockedIntervals::new(),
        };
        (detector, None)
    }

    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn lock_waits(&self) -> LockWaits {
        LockWaits
    }

    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) fn is_exact(&self) -> bool {
        task_slot::sees_switches()
    }

    /// Reading the clock costs as much as knowing.
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn has_not_run(&self) -> bool {
        false
    }

    /// See [`has_not_run`](Self::has_not_run).
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn is_off_cpu(&self) -> bool {
        false
    }

    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn skip_reading(&mut self, _now: Nanos) {}

    /// Takes what the hooks have recorded since the last reading; the task's CPU clock, `None` once
    /// it has ended.
    pub(crate) fn read(
        &mut self,
        _: &ThreadCpuClock,
        _since: Nanos,
        now: Nanos,
        _: impl FnMut(Nanos, Switch),
    ) -> Option<Nanos> {
        let read = &mut self.read;
        self.slot?.state.with(|s| {
            if s.blocked.len > 0 {
                *read = s.blocked;
            } else {
                read.len = 0; // mostly, and cheaper than to copy
            }
            begin(s, now)
        })
    }

    /// Starts afresh with a task that runs; its CPU clock.
    pub(crate) fn restart(
        &mut self,
        _: &ThreadCpuClock,
        now: Nanos,
        _: impl FnMut(Nanos, Switch),
    ) -> Option<Nanos> {
        self.read.len = 0;
        self.slot?.state.with(|s| begin(s, now))
    }

    /// Nothing to note: where the hooks see no switches, every reading is unknown.
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn lost(&mut self, _now: Nanos) {}

    /// Asks for a wake-up of the enforcer when the task's CPU clock shows `at` (`Nanos::MAX`:
    /// none). Returns whether that works; otherwise the enforcer's timer must be set instead.
    pub(crate) fn limit(&self, timer: Option<&TimerFd>, at: Nanos) -> bool {
        let by = timer.and_then(TimerFd::owner);
        self.slot.is_some_and(|slot| alarm::limit(slot, by, at))
    }

    /// Whether the task's CPU clock has come to the limit, within `slack`; `None` without a limit.
    pub(crate) fn is_at_limit(&self, now: Nanos, slack: Nanos) -> Option<bool> {
        alarm::is_at_limit(self.slot?, now, slack)
    }

    /// A suspension here is a change of priority: a block that has begun is the task's own.
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn forget_block(&mut self) {}

    pub(crate) fn readings(&self) -> Readings<'_> {
        if task_slot::sees_switches() {
            Readings::Exact(self.read.list.get(..self.read.len).unwrap_or(&[]))
        } else {
            Readings::Unknown
        }
    }
}

/// Begins a new stretch of records.
fn begin(s: &mut TaskState, now: Nanos) -> Option<Nanos> {
    let cpu = s.cpu(now);
    s.blocked.clear(cpu);
    (!s.ended).then_some(cpu)
}
