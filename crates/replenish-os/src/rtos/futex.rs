//! Waiting on a word of memory.
//!
//! ```text
//!   wait:  masked { word as expected? note word and deadline in the task's slot } block
//!   wake:  masked { highest slot that waits on the word: forget the word }        wake its task
//!   alarm: each slot whose deadline is due (the back end's)                       wake its task
//! ```
//!
//! A woken task finds out by itself why it was woken: a wake-up too many costs one look, no harm.

use super::critical_section::CriticalSection;
use super::cs_token::CsToken;
use crate::Nanos;
use crate::backend::port::alarm;
use crate::backend::port::task_slot::{self, NEVER, TaskSlot};
use crate::backend::port::{self, Task};
use core::ptr;
use core::sync::atomic::{AtomicU32, Ordering};

/// Sleeps while `word` has the value `expected`, at most until `deadline`.
///
/// Returns whether the deadline has passed.
pub(crate) fn wait(word: &AtomicU32, expected: u32, deadline: Option<Nanos>) -> bool {
    let me = task_slot::current();
    sleep(me, word, expected, deadline, CriticalSection::enter());
    // Mostly the word has changed, and reading the clock costs more than this look.
    word.load(Ordering::Relaxed) == expected && deadline.is_some_and(|t| port::board_now() >= t)
}

/// As [`wait`], for a caller inside a critical section, which this leaves.
pub(crate) fn wait_and_leave(
    word: &AtomicU32,
    expected: u32,
    deadline: Option<Nanos>,
    section: CriticalSection,
) {
    sleep(task_slot::current(), word, expected, deadline, section);
}

fn sleep(
    me: Option<&'static TaskSlot>,
    word: &AtomicU32,
    expected: u32,
    deadline: Option<Nanos>,
    section: CriticalSection,
) {
    let Some(me) = me else { return };
    // A thread that changes the word looks for waiters afterwards, masked: either this look sees
    // the change, or that one finds this waiter.
    if word.load(Ordering::Relaxed) != expected {
        return;
    }
    let at = deadline.unwrap_or(NEVER);
    me.state.within(section.token(), |s| {
        s.waits_on = ptr::from_ref(word);
        s.deadline = at;
    });
    if at != NEVER {
        alarm::program(at, section.token());
    }
    drop(section);
    port::block();
    me.state.with(|s| {
        s.waits_on = ptr::null();
        s.deadline = NEVER;
        s.lends = false; // a wait for a lock sets it anew
    });
}

/// Wakes the highest task that waits on `word`. From tasks and interrupts; not while masked.
pub(crate) fn wake_one(word: &AtomicU32) {
    let section = CriticalSection::enter();
    let highest = take_waiter(word, section.token());
    drop(section);
    if let Some((_, Some(task))) = highest {
        port::wake(task);
    }
}

/// Takes the highest task that waits on `word` off the word.
pub(crate) fn take_waiter(
    word: &AtomicU32,
    cs: CsToken<'_>,
) -> Option<(&'static TaskSlot, Option<Task>)> {
    let mut best: Option<(u8, &'static TaskSlot)> = None;
    for slot in task_slot::all() {
        let (on, priority) = slot.state.within(cs, |s| (s.waits_on, s.effective));
        // Newest first: with >=, the oldest of equals wins.
        if ptr::eq(on, word) && best.is_none_or(|(p, _)| priority >= p) {
            best = Some((priority, slot));
        }
    }
    let (_, slot) = best?;
    let task = slot.state.within(cs, |s| {
        s.waits_on = ptr::null();
        s.task
    });
    Some((slot, task))
}

/// Whether some task waits on `word`.
pub(crate) fn has_waiter(word: &AtomicU32, cs: CsToken<'_>) -> bool {
    task_slot::all().any(|slot| slot.state.within(cs, |s| ptr::eq(s.waits_on, word)))
}

/// Sleeps until `t`.
pub(crate) fn sleep_until(t: Nanos) {
    let word = AtomicU32::new(0);
    if port::board_now() < t {
        while !wait(&word, 0, Some(t)) {}
    }
}
