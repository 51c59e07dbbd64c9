//! Which stretches of a callback its task spent blocked, from the switch hooks.

use super::gaps::Gaps;
use super::slot::{self, Slot};
use super::timer::TimerFd;
use crate::Nanos;
use crate::Tid;
use sporadic::Gap;

/// The record of one supervised task, read by its enforcer.
#[derive(Debug)]
pub(crate) struct Watch {
    slot: Option<&'static Slot>,
    read: Gaps,
}

impl Watch {
    pub(crate) fn new(tid: Tid, _exact: bool) -> Self {
        Self {
            slot: slot::find(tid.get()),
            read: Gaps::new(),
        }
    }

    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) fn is_exact(&self) -> bool {
        slot::sees_switches()
    }

    /// Reading the clock costs as much as knowing.
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn has_not_run(&self) -> bool {
        false
    }

    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn skip_reading(&mut self, _now: Nanos) {}

    /// Takes what the hooks have recorded since the last reading.
    pub(crate) fn read(&mut self, _since: Nanos, now: Nanos) {
        let Some(slot) = self.slot else { return };
        let read = &mut self.read;
        slot.state.with(|s| {
            if s.gaps.len > 0 {
                *read = s.gaps;
            } else {
                read.len = 0; // mostly, and cheaper than to copy
            }
            let cpu = s.cpu(now);
            s.gaps.clear(cpu);
        });
    }

    /// Starts afresh with a task that runs.
    pub(crate) fn restart(&mut self, now: Nanos) {
        self.read.len = 0;
        let Some(slot) = self.slot else { return };
        slot.state.with(|s| {
            let cpu = s.cpu(now);
            s.gaps.clear(cpu);
        });
    }

    /// It is not known when the task blocked: all since the last reading counts from `now`.
    pub(crate) fn lost(&mut self, since: Nanos, now: Nanos) {
        self.read = Gaps::new();
        self.read.len = 1;
        if let Some(first) = self.read.list.first_mut() {
            *first = Gap {
                ran: 0,
                out_at: since,
                in_at: now,
            };
        }
    }

    /// Has the enforcer woken when the task's CPU clock shows `at`; whether that can be done, or its timer
    /// must be set instead.
    pub(crate) fn limit(&self, timer: Option<&TimerFd>, at: Option<Nanos>) -> bool {
        let by = timer.and_then(TimerFd::owner);
        self.slot.is_some_and(|slot| slot::limit(slot, by, at))
    }

    /// Whether the task is there, within `slack`; `None` if nothing was to be told.
    pub(crate) fn is_at_limit(&self, now: Nanos, slack: Nanos) -> Option<bool> {
        slot::is_at_limit(self.slot?, now, slack)
    }

    /// A suspension here is a change of priority, no block.
    pub(crate) fn forget_block(&mut self) {
        if let Some(slot) = self.slot {
            slot.state.with(|s| s.gaps.forget_open());
        }
    }

    pub(crate) fn gaps(&self) -> &[Gap] {
        self.read.list.get(..self.read.len).unwrap_or(&[])
    }
}
