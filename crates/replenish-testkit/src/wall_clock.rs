//! A wall clock that a test may set: for this process alone, without privileges.
//!
//! [`settable_wall_clock!`](crate::settable_wall_clock) gives a test binary a `clock_gettime` of
//! its own, which the linker takes before that of the C library. It asks the kernel, and moves what
//! `CLOCK_REALTIME` says. Waits know nothing of it: a wait by the wall clock is too short or too
//! long, as when the clock is set.
#![expect(unsafe_code, reason = "clock_gettime")]

use std::sync::atomic::{AtomicI64, Ordering};

/// Seconds by which the clock was moved.
static MOVED: AtomicI64 = AtomicI64::new(0);

/// Sets the wall clock forward by `seconds`, or back if they are negative.
pub fn advance(seconds: i64) {
    MOVED.fetch_add(seconds, Ordering::SeqCst);
}

/// `clock_gettime(2)` with the wall clock as it was set.
///
/// # Safety
/// `time` is valid for writing.
pub unsafe fn gettime(clock: libc::clockid_t, time: *mut libc::timespec) -> libc::c_int {
    // SAFETY: the caller's promise; a clock that is unknown is an error.
    let rc = unsafe { libc::syscall(libc::SYS_clock_gettime, clock, time) };
    if rc == 0 && clock == libc::CLOCK_REALTIME {
        // SAFETY: the kernel has written it.
        unsafe { (*time).tv_sec += MOVED.load(Ordering::SeqCst) };
    }
    if rc == 0 { 0 } else { -1 }
}

/// Lets this test binary [set the wall clock](advance).
#[macro_export]
macro_rules! settable_wall_clock {
    () => {
        #[unsafe(no_mangle)]
        extern "C" fn clock_gettime(
            clock: $crate::libc::clockid_t,
            time: *mut $crate::libc::timespec,
        ) -> $crate::libc::c_int {
            // SAFETY: as the C library's callers promise.
            unsafe { $crate::wall_clock::gettime(clock, time) }
        }
    };
}
