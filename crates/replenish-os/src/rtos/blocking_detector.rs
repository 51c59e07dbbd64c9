//! Which stretches of a callback its task spent blocked, from the switch hooks.

use super::blocked_intervals::BlockedIntervals;
use super::clock::ThreadCpuClock;
use super::timer::TimerFd;
use crate::Nanos;
use crate::Tid;
use crate::backend::port::alarm;
use crate::backend::port::task_slot::{self, TaskSlot, TaskState};
use sporadic::Gap;

/// The record of one supervised task, read by its enforcer.
#[derive(Debug)]
pub(crate) struct BlockingDetector {
    slot: Option<&'static TaskSlot>,
    read: BlockedIntervals,
}

impl BlockingDetector {
    pub(crate) fn new(tid: Tid, _exact: bool) -> Self {
        Self {
            slot: task_slot::find(tid.get()),
            read: BlockedIntervals::new(),
        }
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

    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn skip_reading(&mut self, _now: Nanos) {}

    /// Takes what the hooks have recorded since the last reading; the task's CPU clock, `None` once
    /// it has ended.
    pub(crate) fn read(&mut self, _: &ThreadCpuClock, _since: Nanos, now: Nanos) -> Option<Nanos> {
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
    pub(crate) fn restart(&mut self, _: &ThreadCpuClock, now: Nanos) -> Option<Nanos> {
        self.read.len = 0;
        self.slot?.state.with(|s| begin(s, now))
    }

    /// It is not known when the task blocked: all since the last reading counts from `now`.
    pub(crate) fn lost(&mut self, since: Nanos, now: Nanos) {
        self.read = BlockedIntervals::new();
        self.read.len = 1;
        if let Some(first) = self.read.list.first_mut() {
            *first = Gap {
                ran: 0,
                out_at: since,
                in_at: now,
            };
        }
    }

    /// Asks for a wake-up of the enforcer when the task's CPU clock shows `at` (`Nanos::MAX`:
    /// none). Returns whether that works; otherwise the enforcer's timer must be set instead.
    pub(crate) fn limit(&self, timer: Option<&TimerFd>, at: Nanos) -> bool {
        let by = timer.and_then(TimerFd::owner);
        self.slot.is_some_and(|slot| alarm::limit(slot, by, at))
    }

    /// Whether the task is there, within `slack`; `None` if nothing was to be told.
    pub(crate) fn is_at_limit(&self, now: Nanos, slack: Nanos) -> Option<bool> {
        alarm::is_at_limit(self.slot?, now, slack)
    }

    /// A suspension here is a change of priority, no block.
    pub(crate) fn forget_block(&mut self) {
        if let Some(slot) = self.slot {
            slot.state.with(|s| s.blocked.forget_open());
        }
    }

    pub(crate) fn gaps(&self) -> &[Gap] {
        self.read.list.get(..self.read.len).unwrap_or(&[])
    }
}

/// From here on records are new.
fn begin(s: &mut TaskState, now: Nanos) -> Option<Nanos> {
    let cpu = s.cpu(now);
    s.blocked.clear(cpu);
    (!s.ended).then_some(cpu)
}
