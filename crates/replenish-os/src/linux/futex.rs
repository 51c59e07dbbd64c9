//! The futex operations this crate uses, all on process-private words (`futex(2)`).
#![expect(unsafe_code, reason = "futex has no wrapper in any C library")]

use super::sys;
use std::sync::atomic::AtomicU32;

const PRIVATE: i32 = libc::FUTEX_PRIVATE_FLAG;

/// `FUTEX_LOCK_PI`: takes the lock in `word`, boosting its owner while this thread waits.
/// Returns 0 when the lock is held, else the error number.
pub(super) fn lock_pi(word: &AtomicU32) -> i32 {
    op(word, libc::FUTEX_LOCK_PI | PRIVATE, 0)
}

/// `FUTEX_UNLOCK_PI`: hands the lock to the waiter with the highest priority.
/// Returns 0 or the error number.
pub(super) fn unlock_pi(word: &AtomicU32) -> i32 {
    op(word, libc::FUTEX_UNLOCK_PI | PRIVATE, 0)
}

fn op(word: &AtomicU32, op: i32, val: u32) -> i32 {
    let no_timeout = std::ptr::null::<libc::timespec>();
    // SAFETY: the word outlives the call, and the kernel writes it only as atomics allow; the
    // remaining arguments are unused by these operations.
    let rc = unsafe { libc::syscall(libc::SYS_futex, word.as_ptr(), op, val, no_timeout) };
    if rc == -1 { sys::errno() } else { 0 }
}

/// Stub.
pub(super) fn wait(word: &AtomicU32, val: u32, _: Option<crate::Nanos>) {
    let no_timeout = std::ptr::null::<libc::timespec>();
    // SAFETY: stub
    unsafe { libc::syscall(libc::SYS_futex, word.as_ptr(), libc::FUTEX_WAIT | PRIVATE, val, no_timeout) };
}
pub(super) fn wake(word: &AtomicU32, n: u32) {
    // SAFETY: stub
    unsafe { libc::syscall(libc::SYS_futex, word.as_ptr(), libc::FUTEX_WAKE | PRIVATE, n) };
}
