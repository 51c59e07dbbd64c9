//! Changing priorities of threads. The system puts a thread that was raised or lowered at the tail
//! of its new list, as POSIX wants it for both ends of a budget.

use super::task_slot;
use crate::MAX_PRIORITY;
use crate::Tid;
use crate::rtos::error::OsError;
use crate::rtos::inherit;
use crate::rtos::tid::current_tid;
use sporadic::Level;

/// A scheduling class with its priority, 1 (lowest) to 99.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum SchedClass {
    /// Below every priority of ours: FIFO at the lowest priority of the system, 1.
    Other,
    /// FIFO at this priority.
    Fifo(u8),
    /// Equals take turns; needs `CONFIG_RR_INTERVAL`.
    RoundRobin(u8),
}

/// Puts thread `tid` into `class`.
///
/// # Errors
/// For a priority outside `1..=99`, for a thread that has ended, and with the system's error.
pub fn set_priority(tid: Tid, class: SchedClass) -> Result<(), OsError> {
    match class {
        SchedClass::Other => place(tid, 0),
        SchedClass::Fifo(priority) => promote(tid, priority),
        SchedClass::RoundRobin(priority) => {
            promote(tid, priority)?;
            let slot = task_slot::find(tid.get()).ok_or(UNKNOWN)?;
            slot.state.with(|s| match s.task {
                Some(_) => slot.thread.set_round_robin(s.effective),
                None => Err(UNKNOWN),
            })
        }
    }
}

const UNKNOWN: OsError = OsError::new("no thread has this number");

/// Gives thread `tid` the priority `hi`, at the tail of that priority's list.
///
/// # Errors
/// As [`set_priority`].
pub fn promote(tid: Tid, hi: u8) -> Result<(), OsError> {
    if !(1..=MAX_PRIORITY).contains(&hi) {
        return Err(OsError::new("priority out of range: allowed 1 to 99"));
    }
    place(tid, hi)
}

/// Lowers thread `tid` to priority `lo`, at the tail of its list. 0 is the lowest there is.
///
/// # Errors
/// As [`set_priority`].
pub fn demote_to_tail(tid: Tid, lo: u8) -> Result<(), OsError> {
    if lo > MAX_PRIORITY {
        return Err(OsError::new("priority out of range: allowed 0 to 99"));
    }
    place(tid, lo)?;
    if tid == current_tid() {
        super::ffi::yield_cpu();
    }
    Ok(())
}

fn place(tid: Tid, priority: u8) -> Result<(), OsError> {
    let slot = task_slot::find(tid.get()).ok_or(UNKNOWN)?;
    if slot.state.with(|s| s.ended) {
        return Err(UNKNOWN);
    }
    inherit::set_base(slot, priority)
}

/// Whether a thread whose change of priority was refused has the wanted level all the same: no
/// privilege is ever taken away here, so it has ended.
pub(crate) const fn has_level(_: Tid, _: u8, _: Level) -> bool {
    true
}
