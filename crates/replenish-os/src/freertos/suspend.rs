//! The low mode that stops an exhausted worker altogether (`Low::Suspend`): priority 0, behind the
//! idle task, where it only ever runs to give back a lock that another task waits for.

use super::sched::{demote_to_tail, promote};
use super::task_slot;
use crate::rtos::critical_section::Guarded;
use crate::rtos::error::OsError;
use crate::rtos::tid;
use crate::{Nanos, Tid};

/// Tells one worker whether it is suspended.
#[derive(Debug)]
pub(crate) struct SuspendCell(Guarded<Option<(Tid, u8, bool)>>);

impl SuspendCell {
    pub(crate) const fn new() -> Self {
        Self(Guarded::new(None))
    }

    /// Makes the calling task one that can be suspended through this cell.
    pub(crate) fn attach_current_thread(&self) -> Result<(), OsError> {
        let slot = task_slot::current().ok_or(OsError::new("not a task"))?;
        let priority = slot.state.with(|s| s.priority);
        self.0
            .with(|cell| *cell = Some((tid::of(slot), priority, false)));
        Ok(())
    }

    /// The task can no longer be suspended.
    pub(crate) fn detach(&self) {
        self.resume();
        self.0.with(|cell| *cell = None);
    }

    pub(crate) fn suspend(&self, tid: Tid, _running: bool) -> Result<(), OsError> {
        self.0.with(|cell| {
            if let Some((_, _, suspended)) = cell {
                *suspended = true;
            }
        });
        demote_to_tail(tid, 0)
    }

    pub(crate) fn resume(&self) {
        let was = self.0.with(|cell| {
            let (tid, high, suspended) = cell.as_mut()?;
            core::mem::take(suspended).then_some((*tid, *high))
        });
        if let Some((tid, high)) = was {
            promote(tid, high).ok();
        }
    }

    pub(crate) fn resume_at(&self, _: Tid, _priority: u8) -> Result<(), OsError> {
        self.resume();
        Ok(())
    }

    pub(crate) fn cancel(&self) {
        self.resume();
    }

    /// No priority is refused here.
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn lower_itself(&self, _: Tid, _low: u8) {}

    /// Inherited time is not counted here.
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn lower(&self, _allowance: Nanos) {}

    /// Never: a suspended task is preempted, it does not sleep.
    #[expect(clippy::unused_self, reason = "the other back ends' name")]
    pub(crate) const fn is_stopped(&self) -> bool {
        false
    }

    /// See [`lower`](Self::lower).
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) const fn inherited(&self, _cpu: Nanos) -> Nanos {
        0
    }

    /// Does not wait: a suspended task does not run.
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) fn wait_while_suspended(&self) {}
}
