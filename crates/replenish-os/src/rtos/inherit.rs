//! Priority inheritance along the waits for locks.
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

use super::critical_section::CriticalSection;
use super::cs_token::CsToken;
use super::error::OsError;
use super::ready_position::ReadyPosition;
use crate::backend::port;
use crate::backend::port::task_slot::{self, TaskSlot};
use core::sync::atomic::{AtomicU32, Ordering};

const WAITERS: u32 = 1 << 31;
/// Longer chains of locks pass no priority on.
const LONGEST_CHAIN: usize = 8;

/// The holder of the lock that `slot` waits for.
fn lender_to(slot: &TaskSlot, cs: CsToken<'_>) -> Option<i32> {
    let word: *const AtomicU32 = slot.state.within(cs, |s| {
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

fn effective(of: &TaskSlot, chain: usize, cs: CsToken<'_>) -> u8 {
    let own = of.state.within(cs, |s| s.priority);
    if chain == 0 {
        return own;
    }
    task_slot::all()
        .filter(|waiter| lender_to(waiter, cs) == Some(of.id))
        .map(|waiter| effective(waiter, chain - 1, cs))
        .fold(own, u8::max)
}

/// Tells the system the thread's effective priority if it is another one.
fn refresh(slot: &'static TaskSlot, place: ReadyPosition, cs: CsToken<'_>) {
    let wanted = effective(slot, LONGEST_CHAIN, cs);
    let now = slot.state.within(cs, |s| s.effective);
    if wanted != now {
        tell(slot, wanted, place, cs).ok(); // as in `lend`
    }
}

fn tell(
    slot: &TaskSlot,
    priority: u8,
    place: ReadyPosition,
    cs: CsToken<'_>,
) -> Result<(), OsError> {
    let task = slot.state.within(cs, |s| {
        s.effective = priority;
        s.task
    });
    task.map_or(Ok(()), |task| port::place(task, priority, place, cs))
}

/// Gives the thread another priority of its own, at the tail of that priority's list.
pub(crate) fn set_base(slot: &'static TaskSlot, priority: u8) -> Result<(), OsError> {
    let section = CriticalSection::enter();
    let cs = section.token();
    let effective_now = slot.state.within(cs, |s| {
        s.priority = priority;
        s.effective
    });
    let wanted = effective(slot, LONGEST_CHAIN, cs);
    let boosted = wanted != priority && effective_now == wanted;
    let done = if boosted {
        Ok(())
    } else {
        tell(slot, wanted, ReadyPosition::Tail, cs)
    };
    raise_owners(slot, cs);
    done
}

/// Raises the holder of the lock that `slot` waits for, and so on along the chain.
fn raise_owners(slot: &TaskSlot, cs: CsToken<'_>) {
    let mut next = lender_to(slot, cs);
    for _ in 0..LONGEST_CHAIN {
        let Some(owner) = next.and_then(task_slot::find) else {
            return;
        };
        refresh(owner, ReadyPosition::Tail, cs);
        next = lender_to(owner, cs);
    }
}

/// The running thread is about to wait for a lock of `owner`'s. It is not noted at the lock's word
/// yet, so the priority is handed along the chain here.
pub(crate) fn lend(owner: &'static TaskSlot, cs: CsToken<'_>) {
    let Some(me) = task_slot::current() else {
        return;
    };
    let mine = effective(me, LONGEST_CHAIN, cs);
    me.state.within(cs, |s| s.lends = true);
    let mut next = Some(owner);
    for _ in 0..LONGEST_CHAIN {
        let Some(owner) = next else { return };
        if owner.state.within(cs, |s| s.effective) < mine {
            // Without the privilege (on a host) there is no inheritance.
            tell(owner, mine, ReadyPosition::Tail, cs).ok();
        }
        next = lender_to(owner, cs).and_then(task_slot::find);
    }
}

/// The running thread no longer waits for a lock of `owner`'s, without having got it.
pub(crate) fn withdraw(owner: &'static TaskSlot, cs: CsToken<'_>) {
    refresh(owner, ReadyPosition::Tail, cs);
    raise_owners(owner, cs);
}

/// The running thread has given a lock back. Whether it may lose an inherited priority, which
/// [`give_back`] carries out when the next owner has been woken.
pub(crate) fn is_boosted(cs: CsToken<'_>) -> bool {
    task_slot::current().is_some_and(|me| me.state.within(cs, |s| s.effective != s.priority))
}

/// The running thread gets the priority it now has a right to.
pub(crate) fn give_back() {
    let Some(me) = task_slot::current() else {
        return;
    };
    let section = CriticalSection::enter();
    refresh(me, ReadyPosition::Head, section.token());
}
