//! Priority inheritance, from who waits for whose lock.
//!
//! ```text
//!   effective(thread) = max(its priority, effective(every thread that waits for a lock it holds))
//! ```
//!
//! It goes through chains of locks, holds while an enforcer lowers the owner, and ends when the
//! owner gives the lock back. Only contended locks cost anything. The systems' own inheritance does
//! not do: FreeRTOS passes nothing along a chain, and both forget the waiters when the priority of
//! the owner is changed, as the end of a budget does.
#![expect(unsafe_code, reason = "reads the words that threads wait on")]

use super::critical_section::{Mask, Quiet};
use super::error::OsError;
use super::ffi;
use super::task_slot::{self, Slot};
use core::sync::atomic::{AtomicU32, Ordering};

const WAITERS: u32 = 1 << 31;
/// Longer chains of locks pass no priority on.
const LONGEST_CHAIN: usize = 8;

/// Who holds the lock that `slot` waits for.
fn lender_to(slot: &Slot, quiet: Quiet<'_>) -> Option<i32> {
    let word: *const AtomicU32 = slot.state.within(quiet, |s| {
        if s.lends {
            s.waits_on
        } else {
            core::ptr::null()
        }
    });
    // SAFETY: the waiting thread borrows the lock until it is taken off the word, which happens
    // masked, as this does.
    let word = unsafe { word.as_ref() }?;
    Some((word.load(Ordering::Relaxed) & !WAITERS).cast_signed())
}

fn effective(of: &Slot, chain: usize, quiet: Quiet<'_>) -> u8 {
    let own = of.state.within(quiet, |s| s.priority);
    if chain == 0 {
        return own;
    }
    task_slot::all()
        .filter(|waiter| lender_to(waiter, quiet) == Some(of.id))
        .map(|waiter| effective(waiter, chain - 1, quiet))
        .fold(own, u8::max)
}

/// Where a thread goes in the list of its new priority.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Place {
    /// Before its equals: it only loses what it had inherited, and ran already (POSIX: a thread
    /// that unlocks is not moved to the tail).
    Head,
    /// Behind its equals.
    Tail,
}

/// Tells the system the thread's effective priority if it is another one.
fn refresh(slot: &'static Slot, place: Place, quiet: Quiet<'_>) {
    let wanted = effective(slot, LONGEST_CHAIN, quiet);
    let now = slot.state.within(quiet, |s| s.effective);
    if wanted != now {
        tell(slot, wanted, place, quiet).ok(); // as in `lend`
    }
}

fn tell(slot: &Slot, priority: u8, place: Place, quiet: Quiet<'_>) -> Result<(), OsError> {
    let task = slot.state.within(quiet, |s| {
        s.effective = priority;
        s.task
    });
    task.map_or(Ok(()), |task| ffi::place(task, priority, place, quiet))
}

/// Gives the thread another priority of its own, at the tail of that priority's list.
pub(crate) fn set_base(slot: &'static Slot, priority: u8) -> Result<(), OsError> {
    let mask = Mask::set();
    let quiet = mask.quiet();
    let effective_now = slot.state.within(quiet, |s| {
        s.priority = priority;
        s.effective
    });
    let wanted = effective(slot, LONGEST_CHAIN, quiet);
    let boosted = wanted != priority && effective_now == wanted;
    let done = if boosted {
        Ok(())
    } else {
        tell(slot, wanted, Place::Tail, quiet)
    };
    raise_owners(slot, quiet);
    done
}

/// Whoever holds what `slot` waits for, and so on along the chain.
fn raise_owners(slot: &Slot, quiet: Quiet<'_>) {
    let mut next = lender_to(slot, quiet);
    for _ in 0..LONGEST_CHAIN {
        let Some(owner) = next.and_then(task_slot::find) else {
            return;
        };
        refresh(owner, Place::Tail, quiet);
        next = lender_to(owner, quiet);
    }
}

/// The running thread is about to wait for a lock of `owner`'s. It is not noted at the lock's word
/// yet, so the priority is handed along the chain here.
pub(crate) fn lend(owner: &'static Slot, quiet: Quiet<'_>) {
    let Some(me) = task_slot::current() else {
        return;
    };
    let mine = effective(me, LONGEST_CHAIN, quiet);
    me.state.within(quiet, |s| s.lends = true);
    let mut next = Some(owner);
    for _ in 0..LONGEST_CHAIN {
        let Some(owner) = next else { return };
        if owner.state.within(quiet, |s| s.effective) < mine {
            // Without the privilege (on a host) there is no inheritance.
            tell(owner, mine, Place::Tail, quiet).ok();
        }
        next = lender_to(owner, quiet).and_then(task_slot::find);
    }
}

/// The running thread no longer waits for a lock of `owner`'s, without having got it.
pub(crate) fn withdraw(owner: &'static Slot, quiet: Quiet<'_>) {
    refresh(owner, Place::Tail, quiet);
    raise_owners(owner, quiet);
}

/// The running thread has given a lock back. Whether it may lose an inherited priority, which
/// [`give_back`] carries out when the next owner has been woken.
pub(crate) fn is_boosted(quiet: Quiet<'_>) -> bool {
    task_slot::current().is_some_and(|me| me.state.within(quiet, |s| s.effective != s.priority))
}

/// The running thread gets the priority it now has a right to.
pub(crate) fn give_back() {
    let Some(me) = task_slot::current() else {
        return;
    };
    let mask = Mask::set();
    refresh(me, Place::Head, mask.quiet());
}
