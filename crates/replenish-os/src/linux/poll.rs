//! Waiting on several descriptors at once, and waking such a wait from another thread.
#![expect(unsafe_code, reason = "a slice of our type passed as one of rustix's")]

use super::clock::monotonic;
use super::sys;
use crate::Nanos;
use rustix::event::{self, EventfdFlags, PollFlags, eventfd};
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

/// A descriptor to wait on, and after [`poll`] what it is ready for.
#[derive(Debug)]
#[repr(transparent)]
pub struct PollFd<'fd>(event::PollFd<'fd>);

impl<'fd> PollFd<'fd> {
    /// Waits until `fd` can be read.
    pub fn readable(fd: &'fd impl AsFd) -> Self {
        Self(event::PollFd::new(fd, PollFlags::IN))
    }

    /// Waits until `fd` can be written.
    pub fn writable(fd: &'fd impl AsFd) -> Self {
        Self(event::PollFd::new(fd, PollFlags::OUT))
    }

    /// Whether the last [`poll`] found what was waited for, or an error or a hang-up, which the
    /// next read or write reports. Either way, the descriptor will not block.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        !self.0.revents().is_empty()
    }

    /// Whether the last [`poll`] found an error or that the other side has gone.
    #[must_use]
    pub fn is_broken(&self) -> bool {
        let broken = PollFlags::ERR | PollFlags::HUP | PollFlags::NVAL;
        self.0.revents().intersects(broken)
    }
}

/// Waits until one of `fds` is ready or [`monotonic`] time has reached `deadline`.
///
/// Without a deadline it waits for ever; with a past one it only looks. Returns how many are
/// ready; 0 means that the deadline passed. Level-triggered: unread data is found again. No
/// allocation; signals do not end the wait.
///
/// The kernel takes the remaining time, so a thread preempted on its way in wakes that much late.
/// If that matters, put a [`TimerFd`](crate::timer::TimerFd) among the descriptors.
///
/// # Errors
/// `EINVAL` for more descriptors than `RLIMIT_NOFILE`, `ENOMEM`; see `ppoll(2)`.
pub fn poll(fds: &mut [PollFd<'_>], deadline: Option<Nanos>) -> io::Result<usize> {
    let fds: *mut [PollFd<'_>] = fds;
    // SAFETY: a `PollFd` is rustix's in memory; the slice is borrowed for as long as this function.
    let fds = unsafe { &mut *(fds as *mut [event::PollFd<'_>]) };
    sys::retry(|| {
        let timeout = deadline.map(|t| sys::timespec(t.saturating_sub(monotonic())));
        Ok(event::poll(fds, timeout.as_ref())?)
    })
}

/// Wakes a thread out of [`poll`] (`eventfd(2)`). Any thread, any number of times.
///
/// The waiter puts it among its descriptors and, once awake, calls [`clear`](Self::clear)
/// *before* it looks at what it was woken for: a wake-up that comes later then stays pending.
#[derive(Debug)]
pub struct WakeFd(OwnedFd);

impl WakeFd {
    /// A descriptor that is not ready; closed on `exec`.
    ///
    /// # Errors
    /// `EMFILE` or `ENFILE` when no descriptor is free.
    pub fn new() -> io::Result<Self> {
        let flags = EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK;
        Ok(Self(eventfd(0, flags)?))
    }

    /// Makes the descriptor readable until it is [cleared](Self::clear). Never waits.
    pub fn wake(&self) {
        // It fails only when the counter is full, and then the descriptor is readable already.
        let _full = rustix::io::write(&self.0, &1_u64.to_ne_bytes());
    }

    /// Takes back all wake-ups so far; returns whether there was one. Never waits.
    pub fn clear(&self) -> bool {
        rustix::io::read(&self.0, &mut [0; size_of::<u64>()]).is_ok()
    }
}

impl AsFd for WakeFd {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}
