//! The deadlines of all tasks on the board's one timer.
//!
//! The timer is set when a deadline comes before what it is set to, and never to a later time: a wait
//! that ends before its deadline leaves it, and the interrupt then finds nothing due. One look of an
//! interrupt too many costs less than looking through all tasks with every wait.

use super::critical_section::{Mask, Masked, Quiet};
use super::ffi;
use super::task_slot::{self, NEVER};
use crate::Nanos;

/// What the board's timer is set to.
static SET: Masked<Nanos> = Masked::new(NEVER);

/// Before the kernel runs: the board counts its overflows when the timer rings, asked or not.
pub(crate) fn begin() {
    ffi::board_arm(NEVER, Mask::set().quiet());
}

/// A task's deadline is `at` now.
pub(crate) fn program(at: Nanos, quiet: Quiet<'_>) {
    SET.within(quiet, |set| {
        if at < *set {
            *set = at;
            ffi::board_arm(at, quiet);
        }
    });
}

/// The board's timer interrupt: wakes every task whose deadline has come, in the order of their
/// deadlines, the oldest of equals first; sets the timer for the next.
pub(crate) fn on_timer() {
    loop {
        let now = ffi::board_now();
        let mask = Mask::set();
        let quiet = mask.quiet();
        let limit = task_slot::limit_at(quiet);
        if limit <= now {
            let task = task_slot::reach_limit(quiet);
            drop(mask);
            if let Some(task) = task {
                ffi::wake(task);
            }
            continue;
        }
        // Newest first: with <=, the oldest of equals wins; and one without a deadline never does.
        let (at, first) = task_slot::all().fold((NEVER - 1, None), |(earliest, first), slot| {
            let at = slot.state.within(quiet, |s| s.deadline);
            if at <= earliest {
                (at, Some(slot))
            } else {
                (earliest, first)
            }
        });
        let due = first.filter(|_| at <= now);
        let Some(slot) = due else {
            let at = at.min(limit);
            SET.within(quiet, |set| *set = at);
            ffi::board_arm(at, quiet);
            return;
        };
        let task = slot.state.within(quiet, |s| {
            s.deadline = NEVER;
            s.task
        });
        drop(mask);
        if let Some(task) = task {
            ffi::wake(task);
        }
    }
}
