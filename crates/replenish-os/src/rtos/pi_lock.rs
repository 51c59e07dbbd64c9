//! A lock with priority inheritance: a word, and the slots of the waiting tasks.
//!
//! ```text
//!        lock: CAS                another task waits: it sets bit 31
//!   0 ───────────────► owner ───────────────────────────► owner | WAITERS
//!   ▲                    │ unlock: CAS                       │ unlock, masked
//!   └────────────────────┘◄───────────── the highest waiter ◄┘
//! ```
//!
//! A waiter lends the owner its priority (`inherit`), through chains of locks, until the owner has
//! given the lock back.

use super::critical_section::CriticalSection;
use super::futex;
use super::inherit;
use super::tid::current_tid;
use crate::Nanos;
use crate::backend::port;
use crate::backend::port::task_slot;
use core::sync::atomic::{AtomicU32, Ordering, compiler_fence};

const WAITERS: u32 = 1 << 31;

/// Waits for the lock and takes it; panics where it would wait for ever.
pub(crate) fn lock(lock: &AtomicU32) {
    let me = me();
    if !take(lock, me) {
        lock_slow(lock, me, None);
    }
}

/// Whether it could be taken until then.
pub(crate) fn lock_until(lock: &AtomicU32, deadline: Nanos) -> bool {
    let me = me();
    take(lock, me) || lock_slow(lock, me, Some(deadline))
}

/// Whether it was free.
pub(crate) fn try_lock(lock: &AtomicU32) -> bool {
    take(lock, me())
}

/// Takes it if it is free.
fn take(lock: &AtomicU32, me: u32) -> bool {
    swap(lock, 0, me, Ordering::Acquire)
}

fn me() -> u32 {
    current_tid().get().cast_unsigned()
}

/// Waits; whether it has the lock, which it has if there is no deadline.
#[cold]
#[inline(never)]
fn lock_slow(lock: &AtomicU32, me: u32, deadline: Option<Nanos>) -> bool {
    let mut waits = false;
    loop {
        let section = CriticalSection::enter();
        let word = lock.load(Ordering::Acquire);
        let owner = word & !WAITERS;
        let mine = if owner == 0 {
            swap(lock, word, me, Ordering::Acquire)
        } else {
            // Handed over by the unlock, while it slept.
            waits && owner == me
        };
        let holder = task_slot::find(owner.cast_signed());
        let ended = holder.is_some_and(|s| s.state.within(section.token(), |s| s.ended));
        if mine || owner == me || ended {
            drop(section);
            assert!(!ended, "PiMutex: the task that holds the lock has ended");
            assert!(mine, "PiMutex: this task holds the lock already");
            return true;
        }
        // The mark for waiters may stay: the unlock finds that there is none.
        if deadline.is_some_and(|t| port::board_now() >= t) {
            if let Some(holder) = holder {
                inherit::withdraw(holder, section.token());
            }
            return false;
        }
        // Taken or given back between the reading and now: look again.
        let expected = word | WAITERS;
        if owner == 0 || !swap(lock, word, expected, Ordering::Relaxed) {
            continue;
        }
        if let Some(holder) = holder {
            inherit::lend(holder, section.token());
        }
        waits = true;
        // Still masked: the owner cannot give it back before this task is on the list.
        futex::wait_and_leave(lock, expected, deadline, section);
    }
}

/// Compare and swap. There is one core: `order` is for the compiler, and no barrier is needed.
fn swap(lock: &AtomicU32, from: u32, to: u32, order: Ordering) -> bool {
    if order == Ordering::Release {
        compiler_fence(order);
    }
    let swapped = lock
        .compare_exchange(from, to, Ordering::Relaxed, Ordering::Relaxed)
        .is_ok();
    if order == Ordering::Acquire {
        compiler_fence(order);
    }
    swapped
}

/// Unlocks; to be called by the owner.
pub(crate) fn unlock(lock: &AtomicU32) {
    if !swap(lock, me(), 0, Ordering::Release) {
        unlock_slow(lock); // somebody waits
    }
}

/// Hands the lock to the waiter of the highest priority.
#[cold]
#[inline(never)]
fn unlock_slow(lock: &AtomicU32) {
    let section = CriticalSection::enter();
    let next = futex::take_waiter(lock, section.token());
    let word = next.map_or(0, |(slot, _)| {
        let more = if futex::has_waiter(lock, section.token()) {
            WAITERS
        } else {
            0
        };
        slot.id.cast_unsigned() | more
    });
    lock.store(word, Ordering::Release);
    let boosted = inherit::is_boosted(section.token());
    drop(section);
    if let Some((_, Some(task))) = next {
        port::wake(task);
    }
    if boosted {
        inherit::give_back();
    }
}
