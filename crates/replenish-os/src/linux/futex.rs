//! The futex operations this crate uses, all on process-private words (`futex(2)`).

use super::sys;
use crate::Nanos;
use rustix::io::{Errno, Result};
use rustix::thread::futex::{self, Flags};
use std::num::NonZeroU32;
use std::sync::atomic::AtomicU32;

const PRIVATE: Flags = Flags::PRIVATE;
const ANY: NonZeroU32 = NonZeroU32::MAX; // FUTEX_BITSET_MATCH_ANY

/// `FUTEX_LOCK_PI`: takes the lock in `word`, boosting its owner while this thread waits.
/// Returns 0 when the lock is held, else the error number.
pub(super) fn lock_pi(word: &AtomicU32) -> i32 {
    number(futex::lock_pi(word, PRIVATE, None))
}

/// As [`lock_pi`], but not longer than until the absolute `CLOCK_MONOTONIC` time `deadline`: then
/// `ETIMEDOUT`. `FUTEX_LOCK_PI2`, Linux 5.14; `ENOSYS` before that.
pub(super) fn lock_pi_until(word: &AtomicU32, deadline: Nanos) -> i32 {
    number(futex::lock_pi2(
        word,
        PRIVATE,
        Some(&sys::timespec(deadline)),
    ))
}

/// `FUTEX_TRYLOCK_PI`: takes the lock in `word` if no thread holds it that has run since it was
/// handed the lock, and if the calling thread is more urgent than all that wait for it.
pub(super) fn trylock_pi(word: &AtomicU32) -> bool {
    futex::trylock_pi(word, PRIVATE).unwrap_or(false)
}

/// `FUTEX_UNLOCK_PI`: hands the lock to the waiter with the highest priority.
/// Returns 0 or the error number.
pub(super) fn unlock_pi(word: &AtomicU32) -> i32 {
    number(futex::unlock_pi(word, PRIVATE))
}

/// `FUTEX_WAIT_BITSET`: sleeps while `word` has the value `expected`, at most until the absolute
/// `CLOCK_MONOTONIC` time `deadline`. Returns whether the deadline has passed; every other reason
/// to return (woken, a signal, another value) means: look at the word.
pub(crate) fn wait(word: &AtomicU32, expected: u32, deadline: Option<Nanos>) -> bool {
    let deadline = deadline.map(sys::timespec);
    let woken = futex::wait_bitset(word, PRIVATE, expected, deadline.as_ref(), ANY);
    woken == Err(Errno::TIMEDOUT)
}

/// `FUTEX_WAKE` of one waiter.
pub(crate) fn wake_one(word: &AtomicU32) {
    let woken = futex::wake(word, PRIVATE, 1);
    debug_assert!(woken.is_ok(), "FUTEX_WAKE: {woken:?}");
}

fn number(result: Result<()>) -> i32 {
    result.err().map_or(0, Errno::raw_os_error)
}
