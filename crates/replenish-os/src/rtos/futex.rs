//! Waiting on a word of memory.
//!
//! ```text
//!   wait:  masked { word still as expected? note word and deadline in the slot } block
//!   wake:  masked { highest slot that waits on the word: forget the word }       wake its task
//!   alarm: each slot whose deadline is due (the back end's)                      wake its task
//! ```
//!
//! A task that is woken finds out by itself why, so a wake-up too many costs a look and no harm.

use super::alarm;
use super::critical_section::{Mask, Quiet};
use super::ffi::{self, Task};
use super::task_slot::{self, NEVER, Slot};
use crate::Nanos;
use core::ptr;
use core::sync::atomic::{AtomicU32, Ordering};

/// Sleeps while `word` has the value `expected`, at most until `deadline`; whether that has passed.
pub(crate) fn wait(word: &AtomicU32, expected: u32, deadline: Option<Nanos>) -> bool {
    let me = task_slot::current();
    sleep(me, word, expected, deadline, Mask::set());
    // Mostly it has changed, and reading the clock costs more than a look.
    word.load(Ordering::Relaxed) == expected && deadline.is_some_and(|t| ffi::board_now() >= t)
}

/// The same for a caller that is masked already, and unmasked on return.
pub(crate) fn wait_masked(word: &AtomicU32, expected: u32, deadline: Option<Nanos>, mask: Mask) {
    sleep(task_slot::current(), word, expected, deadline, mask);
}

fn sleep(
    me: Option<&'static Slot>,
    word: &AtomicU32,
    expected: u32,
    deadline: Option<Nanos>,
    mask: Mask,
) {
    let Some(me) = me else { return };
    // Who changes it looks for waiters after that, and masked: it is seen here, or finds this one.
    if word.load(Ordering::Relaxed) != expected {
        return;
    }
    let at = deadline.unwrap_or(NEVER);
    me.state.within(mask.quiet(), |s| {
        s.waits_on = ptr::from_ref(word);
        s.deadline = at;
    });
    if at != NEVER {
        alarm::program(at, mask.quiet());
    }
    drop(mask);
    ffi::block();
    me.state.with(|s| {
        s.waits_on = ptr::null();
        s.deadline = NEVER;
        s.lends = false; // a wait for a lock sets it anew
    });
}

/// Wakes the highest task that waits on `word`. From tasks and interrupts; not while masked.
pub(crate) fn wake_one(word: &AtomicU32) {
    let mask = Mask::set();
    let highest = take_waiter(word, mask.quiet());
    drop(mask);
    if let Some((_, Some(task))) = highest {
        ffi::wake(task);
    }
}

/// The highest task that waits on `word`, which it then no longer does.
pub(crate) fn take_waiter(
    word: &AtomicU32,
    quiet: Quiet<'_>,
) -> Option<(&'static Slot, Option<Task>)> {
    let mut best: Option<(u8, &'static Slot)> = None;
    for slot in task_slot::all() {
        let (on, priority) = slot.state.within(quiet, |s| (s.waits_on, s.effective));
        // Newest first: with >=, the oldest of equals wins.
        if ptr::eq(on, word) && best.is_none_or(|(p, _)| priority >= p) {
            best = Some((priority, slot));
        }
    }
    let (_, slot) = best?;
    let task = slot.state.within(quiet, |s| {
        s.waits_on = ptr::null();
        s.task
    });
    Some((slot, task))
}

/// Whether some task waits on `word`.
pub(crate) fn has_waiter(word: &AtomicU32, quiet: Quiet<'_>) -> bool {
    task_slot::all().any(|slot| slot.state.within(quiet, |s| ptr::eq(s.waits_on, word)))
}

/// Sleeps until `t`.
pub(crate) fn sleep_until(t: Nanos) {
    let word = AtomicU32::new(0);
    if ffi::board_now() < t {
        while !wait(&word, 0, Some(t)) {}
    }
}
