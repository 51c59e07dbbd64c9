//! The system's calls that act on a thread: wait, wake, set the priority.

use super::task_slot::{self, NEVER, Task};
use crate::rtos::cs_token::CsToken;
use crate::rtos::error::OsError;
use crate::rtos::ready_position::ReadyPosition;

/// Blocks the calling thread until it is woken or its slot's deadline has come; not while masked.
pub(crate) fn block() {
    let Some(me) = task_slot::current() else {
        return;
    };
    let until = me.state.with(|s| {
        s.parked_until = s.deadline;
        s.deadline
    });
    me.thread.park(until);
    me.state.with(|s| {
        s.parked_until = 0;
        s.deadline = NEVER;
    });
}

/// Wakes a thread.
pub(crate) fn wake(task: Task) {
    task.0.thread.unpark();
}

/// Sets the thread's priority. Its position among its equals is the system's choice.
pub(crate) fn place(
    task: Task,
    priority: u8,
    _: ReadyPosition,
    _: CsToken<'_>,
) -> Result<(), OsError> {
    task.0.thread.set_priority(priority)
}
