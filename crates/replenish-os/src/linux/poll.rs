//! Waiting on several descriptors at once, and waking such a wait from another thread.
#![expect(unsafe_code, reason = "ppoll, eventfd, read, write")]

use super::clock::monotonic;
use super::sys;
use crate::Nanos;
use std::io;
use std::marker::PhantomData;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, FromRawFd, OwnedFd};

/// A descriptor to wait on, and after [`poll`] what it is ready for.
#[derive(Debug)]
#[repr(transparent)]
pub struct PollFd<'fd> {
    raw: libc::pollfd,
    borrowed: PhantomData<BorrowedFd<'fd>>,
}

impl<'fd> PollFd<'fd> {
    /// Waits until `fd` can be read.
    pub fn readable(fd: &'fd impl AsFd) -> Self {
        Self::new(fd, libc::POLLIN)
    }

    /// Waits until `fd` can be written.
    pub fn writable(fd: &'fd impl AsFd) -> Self {
        Self::new(fd, libc::POLLOUT)
    }

    fn new(fd: &'fd impl AsFd, events: libc::c_short) -> Self {
        let fd = fd.as_fd().as_raw_fd();
        Self {
            raw: libc::pollfd {
                fd,
                events,
                revents: 0,
            },
            borrowed: PhantomData,
        }
    }

    /// Whether the last [`poll`] found what was waited for, or an error or a hang-up, which the
    /// next read or write reports. Either way, the descriptor will not block.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.raw.revents != 0
    }

    /// Whether the last [`poll`] found an error or that the other side has gone.
    #[must_use]
    pub fn is_broken(&self) -> bool {
        self.raw.revents & (libc::POLLERR | libc::POLLHUP | libc::POLLNVAL) != 0
    }
}

/// Waits until one of `fds` is ready or [`monotonic`] time has reached `deadline`.
///
/// Without a deadline it waits for ever; with a past one it only looks. Returns how many are
/// ready; 0 means that the deadline passed. Level-triggered: unread data is found again. No
/// allocation; signals do not end the wait.
///
/// The kernel takes the remaining time, so a thread preempted on its way in wakes that much late.
/// Where that matters, put a [`TimerFd`](crate::timer::TimerFd) among the descriptors.
///
/// # Errors
/// `EINVAL` for more descriptors than `RLIMIT_NOFILE`, `ENOMEM`; see `ppoll(2)`.
pub fn poll(fds: &mut [PollFd<'_>], deadline: Option<Nanos>) -> io::Result<usize> {
    let count = libc::nfds_t::try_from(fds.len()).map_err(io::Error::other)?;
    let fds = fds.as_mut_ptr().cast::<libc::pollfd>();
    let ready = sys::retry(|| {
        let timeout = deadline.map(|t| sys::timespec(t.saturating_sub(monotonic())));
        let timeout = timeout
            .as_ref()
            .map_or(std::ptr::null(), std::ptr::from_ref);
        // SAFETY: a `PollFd` is a `pollfd` in memory; the slice and the timeout live across the
        // call; a null signal mask is allowed.
        sys::check(unsafe { libc::ppoll(fds, count, timeout, std::ptr::null()) })
    })?;
    Ok(usize::try_from(ready).unwrap_or(0))
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
        // SAFETY: no memory is passed.
        let fd = sys::check(unsafe { libc::eventfd(0, libc::EFD_CLOEXEC | libc::EFD_NONBLOCK) })?;
        // SAFETY: the descriptor is new, open and owned by nobody else.
        Ok(Self(unsafe { OwnedFd::from_raw_fd(fd) }))
    }

    /// Makes the descriptor readable until it is [cleared](Self::clear). Never waits.
    pub fn wake(&self) {
        let one = 1_u64;
        // It fails only when the counter is full, and then the descriptor is readable already.
        // SAFETY: eight readable bytes that live across the call.
        unsafe {
            libc::write(
                self.0.as_raw_fd(),
                (&raw const one).cast(),
                size_of::<u64>(),
            )
        };
    }

    /// Takes back all wake-ups so far; returns whether there was one. Never waits.
    pub fn clear(&self) -> bool {
        let mut count = 0_u64;
        // SAFETY: eight writable bytes that live across the call.
        let rc = unsafe {
            libc::read(
                self.0.as_raw_fd(),
                (&raw mut count).cast(),
                size_of::<u64>(),
            )
        };
        rc > 0
    }
}

impl AsFd for WakeFd {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}
