//! A lock with priority inheritance: `FUTEX_LOCK_PI` with a fast path of one compare-and-swap.
//!
//! The futex word, as the kernel defines it:
//!
//! ```text
//!        lock: CAS                   another thread waits: kernel sets bit 31
//!   0 ───────────────► owner's tid ───────────────────────► tid | WAITERS
//!   ▲                     │ unlock: CAS                          │ unlock: FUTEX_UNLOCK_PI
//!   └─────────────────────┘◄───────────── new owner's tid ◄──────┘ (the highest waiter)
//! ```
//!
//! While a thread waits in the kernel, the owner runs at no less than that thread's priority,
//! through chains of locks too. A middle-priority thread can therefore not keep a high one
//! waiting longer than the critical section itself.

use super::futex;
use super::suspend;
use super::tid::current_tid;
use crate::Nanos;
use std::sync::atomic::{AtomicU32, Ordering};

/// Waits for the lock and takes it; panics where it would wait for ever.
pub(crate) fn lock(word: &AtomicU32) {
    suspend::enter_critical();
    if !try_acquire(word) {
        lock_slow(word);
    }
}

/// Whether it could be taken until then.
pub(crate) fn lock_until(word: &AtomicU32, deadline: Nanos) -> bool {
    suspend::enter_critical();
    if try_acquire(word) {
        return true;
    }
    loop {
        match futex::lock_pi_until(word, deadline) {
            0 => return true,
            libc::EINTR | libc::EAGAIN | libc::ENOMEM => {}
            libc::ENOSYS => {
                lock_slow(word);
                return true;
            }
            error => {
                suspend::leave_critical();
                match error {
                    libc::ETIMEDOUT => return false,
                    error => refuse(error),
                }
            }
        }
    }
}

/// Whether it was free.
pub(crate) fn try_lock(word: &AtomicU32) -> bool {
    suspend::enter_critical();
    let taken = try_acquire(word);
    if !taken {
        suspend::leave_critical();
    }
    taken
}

fn me() -> u32 {
    current_tid().get().cast_unsigned()
}

fn try_acquire(word: &AtomicU32) -> bool {
    word.compare_exchange(0, me(), Ordering::Acquire, Ordering::Relaxed)
        .is_ok()
}

#[cold]
fn lock_slow(word: &AtomicU32) {
    loop {
        match futex::lock_pi(word) {
            0 => return,
            // EAGAIN: the owner is about to exit; EINTR: the kernel restarts by itself on
            // most versions; ENOMEM: no kernel memory for the inheritance state just now.
            libc::EINTR | libc::EAGAIN | libc::ENOMEM => {}
            error => {
                suspend::leave_critical(); // no guard will do it
                refuse(error)
            }
        }
    }
}

/// By the owner.
pub(crate) fn unlock(word: &AtomicU32) {
    if word
        .compare_exchange(me(), 0, Ordering::Release, Ordering::Relaxed)
        .is_err()
    {
        let error = futex::unlock_pi(word);
        debug_assert_eq!(error, 0, "FUTEX_UNLOCK_PI by the owner");
    }
    suspend::leave_critical();
}

#[cold]
#[expect(
    clippy::panic,
    reason = "documented under # Panics: the alternative is to hang"
)]
fn refuse(error: i32) -> ! {
    match error {
        libc::EDEADLK => panic!("PiMutex: this thread holds the lock already, or a cycle of locks"),
        libc::ESRCH => panic!("PiMutex: the thread that holds the lock has ended"),
        _ => panic!(
            "PiMutex: FUTEX_LOCK_PI: {}",
            std::io::Error::from_raw_os_error(error)
        ),
    }
}
