//! Thread ids: the number of a task's slot.

use crate::Tid;
use crate::backend::port::task_slot::{self, TaskSlot};

/// The number of the slot's task.
pub(crate) const fn of(slot: &TaskSlot) -> Tid {
    Tid::known(slot.id)
}

/// The number of the calling task. Code that runs outside of tasks (before the kernel starts) is
/// given a number that no task has.
#[must_use]
pub fn current_tid() -> Tid {
    task_slot::current().map_or(Tid::known(i32::MAX), of)
}
