//! The deadlines of all tasks on the board's one timer.

use super::ffi;
use super::slot::{self, NEVER};

/// Sets the board's timer for the earliest deadline; masked.
pub(crate) fn program() {
    let earliest = slot::all().map(|s| s.state.with(|s| s.deadline)).min();
    ffi::board_arm(earliest.unwrap_or(NEVER));
}

/// The board's timer interrupt: wakes every task whose deadline has come, sets the next.
pub(crate) fn on_timer() {
    let now = ffi::board_now();
    for slot in slot::all() {
        let due = slot.state.with(|s| {
            let due = s.deadline <= now;
            if due {
                s.deadline = NEVER;
            }
            s.task.filter(|_| due)
        });
        if let Some(task) = due {
            ffi::wake(task);
        }
    }
    let before = ffi::mask();
    program();
    ffi::unmask(before);
}
