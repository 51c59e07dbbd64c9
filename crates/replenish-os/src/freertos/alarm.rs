//! The deadlines of all tasks on the board's one timer.

use super::ffi;
use super::slot::{self, NEVER};

/// Sets the board's timer for the earliest deadline; masked.
pub(crate) fn program() {
    let earliest = slot::all().map(|s| s.state.with(|s| s.deadline)).min();
    ffi::board_arm(earliest.unwrap_or(NEVER));
}

/// The board's timer interrupt: wakes every task whose deadline has come, in the order of their
/// deadlines, the oldest of equals first; sets the timer for the next.
pub(crate) fn on_timer() {
    loop {
        let now = ffi::board_now();
        let before = ffi::mask();
        // Newest first: with <=, the oldest of equals wins.
        let next = slot::all().fold((NEVER, None), |(earliest, first), slot| {
            let at = slot.state.with(|s| s.deadline);
            if at <= earliest && at != NEVER {
                (at, Some(slot))
            } else {
                (earliest, first)
            }
        });
        let (at, due) = match next {
            (at, Some(slot)) if at <= now => (at, Some(slot)),
            (at, _) => (at, None),
        };
        let Some(slot) = due else {
            ffi::board_arm(at);
            ffi::unmask(before);
            return;
        };
        let task = slot.state.with(|s| {
            s.deadline = NEVER;
            s.task
        });
        ffi::unmask(before);
        if let Some(task) = task {
            ffi::wake(task);
        }
    }
}
