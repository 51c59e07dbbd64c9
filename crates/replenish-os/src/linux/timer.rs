//! One-shot timers as file descriptors: one thread blocks in [`TimerFd::read`], any thread arms.

use super::sys;
use crate::Nanos;
use rustix::io::{Errno, read};
use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, timerfd_create, timerfd_settime,
};
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

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
        let fd = timerfd_create(TimerfdClockId::Monotonic, TimerfdFlags::CLOEXEC)?;
        Ok(Self(fd))
    }

    /// A timer that cannot be read any more, as if another file stood in its place.
    #[cfg(test)]
    pub(crate) fn broken() -> Self {
        Self(std::fs::File::open("/").map_or_else(|_| unreachable!("no root"), OwnedFd::from))
    }

    /// Fires once at the absolute time `t`, or at once if `t` has passed (0 included). Replaces
    /// what was armed before and forgets an expiry that was not read.
    ///
    /// # Errors
    /// None that the kernel documents for valid arguments; passed on if it has one.
    pub fn arm(&self, t: Nanos) -> io::Result<()> {
        self.settime(t.max(1)) // the kernel reads 0 as "disarm"
    }

    /// Stops the timer and forgets an expiry that was not read. A thread blocked in
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
    /// The errors of `read(2)`, except for interruption by a signal, which is retried.
    pub fn read(&self) -> io::Result<()> {
        let mut expirations = [0; size_of::<u64>()];
        while let Err(error) = read(&self.0, &mut expirations) {
            if error != Errno::INTR {
                return Err(error.into());
            }
        }
        Ok(())
    }

    fn settime(&self, t: Nanos) -> io::Result<()> {
        let spec = Itimerspec {
            it_interval: sys::timespec(0),
            it_value: sys::timespec(t),
        };
        timerfd_settime(&self.0, TimerfdTimerFlags::ABSTIME, &spec)?;
        Ok(())
    }
}

impl AsFd for TimerFd {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}
