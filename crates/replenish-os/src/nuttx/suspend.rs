//! The low mode that stops an exhausted worker altogether (`Low::Suspend`): not available here. No
//! priority of `NuttX` is below that of its idle task's, and a thread that was stopped by a signal
//! could not give back a lock that another thread waits for.

use crate::rtos::error::OsError;
use crate::{Nanos, Tid};

/// Tells one worker whether it is suspended: never.
#[derive(Debug)]
pub(crate) struct SuspendCell;

#[expect(clippy::unused_self, reason = "the other back ends' names")]
impl SuspendCell {
    pub(crate) const fn new() -> Self {
        Self
    }

    /// Refuses: the error reaches the worker when it enrols.
    pub(crate) const fn attach_current_thread(&self) -> Result<(), OsError> {
        Err(OsError::new(
            "NuttX has no suspension of exhausted workers: give a background priority, 1 or more",
        ))
    }

    pub(crate) const fn detach(&self) {}

    pub(crate) const fn suspend(&self, _: Tid, _running: bool) -> Result<(), OsError> {
        Ok(())
    }

    pub(crate) const fn resume(&self) {}

    pub(crate) const fn resume_at(&self, _: Tid, _priority: u8) -> Result<(), OsError> {
        Ok(())
    }

    pub(crate) const fn lower_itself(&self, _: Tid, _low: u8) {}

    pub(crate) const fn cancel(&self) {}

    /// Inherited time is not counted here.
    pub(crate) const fn lower(&self, _allowance: Nanos) {}

    /// Never: a suspended task is preempted, it does not sleep.
    #[expect(clippy::unused_self, reason = "the other back ends' name")]
    pub(crate) const fn is_stopped(&self) -> bool {
        false
    }

    /// See [`lower`](Self::lower).
    pub(crate) const fn inherited(&self, _cpu: Nanos) -> Nanos {
        0
    }

    pub(crate) const fn wait_while_suspended(&self) {}
}
