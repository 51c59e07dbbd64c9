//! A task's scheduling and stack, read back from the kernel.

use super::task_slot;
use crate::Tid;
use crate::rtos::error::OsError;
use core::fmt;

/// The scheduling of a task. Under an enforcer the priority is that of the moment; a boost by
/// inheritance does not show.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Granted {
    /// The scheduling class.
    pub policy: GrantedPolicy,
    /// The priority, 1 to 99; 0 while it is suspended for want of budget.
    pub priority: u8,
    /// The stack in bytes.
    pub stack_bytes: usize,
}

/// A scheduling class of this kernel.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum GrantedPolicy {
    /// Fixed priorities, equals in order of arrival.
    Fifo,
}

/// Reads what task `tid` has.
///
/// # Errors
/// If no task has this number.
pub fn granted(tid: Tid) -> Result<Granted, OsError> {
    let slot = task_slot::find(tid.get()).ok_or(OsError::new("no task has this number"))?;
    Ok(Granted {
        policy: GrantedPolicy::Fifo,
        priority: slot.state.with(|s| s.priority),
        stack_bytes: slot.stack_bytes,
    })
}

/// `FIFO 60, stack 2048 B`.
impl fmt::Display for Granted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "FIFO {}, stack {} B", self.priority, self.stack_bytes)
    }
}
