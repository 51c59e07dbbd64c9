//! The futex operations this crate uses, all on process-private words (`futex(2)`).
#![expect(unsafe_code, reason = "futex has no wrapper in any C library")]

use super::sys;
use crate::Nanos;
use std::sync::atomic::AtomicU32;

const PRIVATE: i32 = libc::FUTEX_PRIVATE_FLAG;

/// `FUTEX_LOCK_PI`: takes the lock in `word`, boosting its owner while this thread waits.
/// Returns 0 when the lock is held, else the error number.
pub(super) fn lock_pi(word: &AtomicU32) -> i32 {
    op(word, libc::FUTEX_LOCK_PI | PRIVATE, 0)
}

/// As [`lock_pi`], but not longer than until the absolute `CLOCK_MONOTONIC` time `deadline`: then
/// `ETIMEDOUT`. `FUTEX_LOCK_PI2`, Linux 5.14; `ENOSYS` before that.
pub(super) fn lock_pi_until(word: &AtomicU32, deadline: Nanos) -> i32 {
    let timeout = sys::timespec(deadline);
    // SAFETY: the word and the timeout live across the call; the value is unused.
    let rc = unsafe {
        libc::syscall(
            libc::SYS_futex,
            word.as_ptr(),
            libc::FUTEX_LOCK_PI2 | PRIVATE,
            0,
            std::ptr::from_ref(&timeout),
        )
    };
    if rc == -1 { sys::errno() } else { 0 }
}

/// `FUTEX_UNLOCK_PI`: hands the lock to the waiter with the highest priority.
/// Returns 0 or the error number.
pub(super) fn unlock_pi(word: &AtomicU32) -> i32 {
    op(word, libc::FUTEX_UNLOCK_PI | PRIVATE, 0)
}

/// `FUTEX_WAIT_BITSET`: sleeps while `word` has the value `expected`, at most until the absolute
/// `CLOCK_MONOTONIC` time `deadline`. Returns whether the deadline has passed; every other reason
/// to return (woken, a signal, another value) means: look at the word.
pub(crate) fn wait(word: &AtomicU32, expected: u32, deadline: Option<Nanos>) -> bool {
    let timeout = deadline.map(sys::timespec);
    let timeout = timeout
        .as_ref()
        .map_or(std::ptr::null(), std::ptr::from_ref);
    let unused = std::ptr::null::<u32>();
    // SAFETY: the word and the timeout (null: none) live across the call; the second address is
    // not used by this operation.
    let rc = unsafe {
        libc::syscall(
            libc::SYS_futex,
            word.as_ptr(),
            libc::FUTEX_WAIT_BITSET | PRIVATE,
            expected,
            timeout,
            unused,
            libc::FUTEX_BITSET_MATCH_ANY,
        )
    };
    rc == -1 && sys::errno() == libc::ETIMEDOUT
}

/// `FUTEX_WAKE` of one waiter.
pub(crate) fn wake_one(word: &AtomicU32) {
    let error = op(word, libc::FUTEX_WAKE | PRIVATE, 1);
    debug_assert_eq!(error, 0, "FUTEX_WAKE");
}

// The kernel reads the timeout of this system call as two longs.
const _: () = assert!(size_of::<libc::timespec>() == 2 * size_of::<libc::c_long>());

fn op(word: &AtomicU32, op: i32, val: u32) -> i32 {
    let no_timeout = std::ptr::null::<libc::timespec>();
    // SAFETY: the word outlives the call, and the kernel writes it only as atomics allow; the
    // remaining arguments are unused by these operations.
    let rc = unsafe { libc::syscall(libc::SYS_futex, word.as_ptr(), op, val, no_timeout) };
    if rc == -1 { sys::errno() } else { 0 }
}
