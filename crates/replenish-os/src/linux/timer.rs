//! One-shot timers as file descriptors: one thread blocks in [`TimerFd::read`], any thread arms.
#![expect(unsafe_code, reason = "timerfd_create, timerfd_settime, read")]

use super::sys;
use crate::Nanos;
use std::io;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, FromRawFd, OwnedFd};

/// A one-shot timer on `CLOCK_MONOTONIC` (`timerfd_create(2)`). All methods may be called from
/// any thread, also while another blocks in [`read`](Self::read).
#[derive(Debug)]
pub struct TimerFd(OwnedFd);

impl TimerFd {
    /// A disarmed timer; its descriptor is closed on `exec`.
    ///
    /// # Errors
    /// `EMFILE` or `ENFILE` when no descriptor is free.
    pub fn new() -> io::Result<Self> {
        // SAFETY: no memory is passed.
        let fd =
            sys::check(unsafe { libc::timerfd_create(libc::CLOCK_MONOTONIC, libc::TFD_CLOEXEC) })?;
        // SAFETY: the descriptor is new, open and owned by nobody else.
        Ok(Self(unsafe { OwnedFd::from_raw_fd(fd) }))
    }

    /// Fires once at the absolute time `t`, or at once if `t` has passed (0 included). Replaces
    /// what was armed before and forgets an expiry nobody has read.
    ///
    /// # Errors
    /// None that the kernel documents for valid arguments; passed on if it has one.
    pub fn arm(&self, t: Nanos) -> io::Result<()> {
        self.settime(t.max(1)) // the kernel reads 0 as "disarm"
    }

    /// Stops the timer and forgets an expiry nobody has read. A thread blocked in
    /// [`read`](Self::read) goes on waiting.
    ///
    /// # Errors
    /// As [`arm`](Self::arm).
    pub fn disarm(&self) -> io::Result<()> {
        self.settime(0)
    }

    /// Waits until the timer fires and consumes the expiry. With several threads in `read`, one
    /// of them gets it.
    ///
    /// # Errors
    /// What `read(2)` reports, except for interruption by a signal, which is retried.
    pub fn read(&self) -> io::Result<()> {
        let mut expirations = 0_u64;
        let buffer = (&raw mut expirations).cast();
        sys::retry(|| {
            // SAFETY: the buffer is eight writable bytes that live across the call.
            sys::check(unsafe { libc::read(self.0.as_raw_fd(), buffer, size_of::<u64>()) })
        })?;
        Ok(())
    }

    fn settime(&self, t: Nanos) -> io::Result<()> {
        let spec = libc::itimerspec {
            it_interval: sys::zero_timespec(),
            it_value: sys::timespec(t),
        };
        let fd = self.0.as_raw_fd();
        // SAFETY: `spec` lives across the call; a null old value is allowed.
        sys::check(unsafe {
            libc::timerfd_settime(
                fd,
                libc::TFD_TIMER_ABSTIME,
                &raw const spec,
                std::ptr::null_mut(),
            )
        })?;
        Ok(())
    }
}

impl AsFd for TimerFd {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}
