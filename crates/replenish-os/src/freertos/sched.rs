//! Changing priorities of tasks. The kernel puts a task that was raised or lowered at the tail of
//! its new list, as POSIX wants it for both ends of a budget.

use super::task_slot;
use crate::MAX_PRIORITY;
use crate::Tid;
use crate::rtos::error::OsError;
use crate::rtos::inherit;
use sporadic::Level;

/// A scheduling class with its priority, 1 (lowest) to 99.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum SchedClass {
    /// Below every priority: runs while nothing else wants to (priority 1, FIFO).
    Other,
    /// FIFO at this priority.
    Fifo(u8),
    /// Round-robin: this kernel does not have it, so it is refused.
    RoundRobin(u8),
}

/// Puts task `tid` into `class`.
///
/// # Errors
/// For a priority outside `1..=99`, for round-robin, and for a number no task has.
pub fn set_priority(tid: Tid, class: SchedClass) -> Result<(), OsError> {
    match class {
        SchedClass::Other => promote(tid, 1),
        SchedClass::Fifo(priority) => promote(tid, priority),
        SchedClass::RoundRobin(_) => {
            Err(OsError::new("round-robin is not available under FreeRTOS"))
        }
    }
}

/// Gives task `tid` the FIFO priority `hi`, at the tail of that priority's list.
///
/// # Errors
/// As [`set_priority`].
pub fn promote(tid: Tid, hi: u8) -> Result<(), OsError> {
    place(tid, hi, 1)
}

/// Lowers task `tid` to priority `lo`, at the tail of its list. `lo` = 0 stops it: the idle task
/// is before it, and never gives the CPU away (a task that waits for its lock can raise it).
///
/// # Errors
/// As [`set_priority`].
pub fn demote_to_tail(tid: Tid, lo: u8) -> Result<(), OsError> {
    place(tid, lo, 0)
}

fn place(tid: Tid, priority: u8, least: u8) -> Result<(), OsError> {
    if !(least..=MAX_PRIORITY).contains(&priority) {
        let range = "priority out of range: allowed 1 to 99, to be lowered to 0 to 99";
        return Err(OsError::new(range));
    }
    let slot = task_slot::find(tid.get()).ok_or(OsError::new("no task has this number"))?;
    inherit::set_base(slot, priority)
}

/// Whether a thread whose change of priority was refused has the wanted level all the same: no
/// privilege is ever taken away here, so it has ended.
pub(crate) const fn has_level(_: Tid, _: u8, _: Level) -> bool {
    true
}
