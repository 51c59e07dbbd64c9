//! Waiting on the same descriptors again and again, at the price of one system call that does not
//! look at each of them.
#![expect(unsafe_code, reason = "epoll")]

use super::clock::monotonic;
use super::poll::{PollFd, poll};
use super::sys;
use crate::Nanos;
use std::io;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, FromRawFd, OwnedFd};
use std::ptr;

/// Descriptors to be read from (`epoll(7)`, level-triggered), each with a bit of its own.
///
/// [`poll`] enters every descriptor's wait queue and leaves it again at each call; here that
/// happens once, when it is added. One that is closed leaves the set by itself.
#[derive(Debug)]
pub struct WaitSet(OwnedFd);

impl WaitSet {
    /// Descriptors that one [`wait`](Self::wait) tells of.
    const MOST: usize = 4;

    /// An empty set; closed on `exec`.
    ///
    /// # Errors
    /// `EMFILE` or `ENFILE` when no descriptor is free, `ENOMEM`.
    pub fn new() -> io::Result<Self> {
        // SAFETY: no memory is passed.
        let fd = sys::check(unsafe { libc::epoll_create1(libc::EPOLL_CLOEXEC) })?;
        // SAFETY: the descriptor is new, open and owned by nobody else.
        Ok(Self(unsafe { OwnedFd::from_raw_fd(fd) }))
    }

    /// From now on [`wait`](Self::wait) ends when `fd` can be read, or is broken, and tells `bits`.
    ///
    /// # Errors
    /// `EEXIST` if it is there already, `EPERM` for a descriptor that cannot be waited on,
    /// `ENOMEM`, `ENOSPC`; see `epoll_ctl(2)`.
    pub fn add(&self, fd: &impl AsFd, bits: u32) -> io::Result<()> {
        let mut event = libc::epoll_event {
            events: libc::EPOLLIN.cast_unsigned(),
            u64: bits.into(),
        };
        let (set, fd) = (self.0.as_raw_fd(), fd.as_fd().as_raw_fd());
        // SAFETY: `event` is readable for the call.
        sys::check(unsafe { libc::epoll_ctl(set, libc::EPOLL_CTL_ADD, fd, &raw mut event) })
            .map(drop)
    }

    /// Waits until a descriptor is ready or [`monotonic`](crate::clock::monotonic) time has reached
    /// `deadline` (`None`: for ever), as [`poll`] does. Returns the bits of those that are ready,
    /// of four of them at most; 0 means that the deadline passed. No allocation; signals do not end
    /// the wait.
    ///
    /// # Errors
    /// What [`poll`] gives.
    pub fn wait(&self, deadline: Option<Nanos>) -> io::Result<u32> {
        match self.events(deadline) {
            // Before Linux 5.11. The set itself can be waited on, to the nanosecond.
            Err(e) if e.raw_os_error() == Some(libc::ENOSYS) => {
                poll(&mut [PollFd::readable(self)], deadline)?;
                self.events(Some(0))
            }
            bits => bits,
        }
    }

    fn events(&self, deadline: Option<Nanos>) -> io::Result<u32> {
        let mut events = [libc::epoll_event { events: 0, u64: 0 }; Self::MOST];
        let (set, room, to) = (self.0.as_raw_fd(), Self::MOST, events.as_mut_ptr());
        let ready = sys::retry(|| {
            let timeout = deadline.map(|t| sys::timespec(t.saturating_sub(monotonic())));
            let timeout = timeout.as_ref().map_or(ptr::null(), ptr::from_ref);
            let mask = ptr::null::<libc::sigset_t>();
            // SAFETY: `events` has room for that many; the timeout lives across the call; null
            // stands for no timeout and for no change of the signal mask.
            let rc = unsafe {
                libc::syscall(
                    libc::SYS_epoll_pwait2,
                    set,
                    to,
                    room,
                    timeout,
                    mask,
                    0_usize,
                )
            };
            sys::check(libc::c_int::try_from(rc).unwrap_or(-1))
        })?;
        let ready = events.iter().take(usize::try_from(ready).unwrap_or(0));
        Ok(ready.fold(0, |bits, e| bits | u32::try_from(e.u64).unwrap_or(0)))
    }
}

impl AsFd for WaitSet {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{WakeFd, clock};

    #[test]
    fn tells_who_is_ready_for_as_long_as_it_is() {
        let (set, a, b) = (
            WaitSet::new().unwrap(),
            WakeFd::new().unwrap(),
            WakeFd::new().unwrap(),
        );
        set.add(&a, 1).unwrap();
        set.add(&b, 2).unwrap();
        assert_eq!(set.wait(Some(0)).unwrap(), 0);
        b.wake();
        assert_eq!(set.wait(None).unwrap(), 2);
        a.wake();
        assert_eq!(set.wait(None).unwrap(), 3);
        assert_eq!(set.wait(Some(u64::MAX)).unwrap(), 3);
        b.clear();
        assert_eq!(set.wait(None).unwrap(), 1);
        drop(a);
        let until = clock::monotonic() + 1_000_000;
        assert_eq!(set.wait(Some(until)).unwrap(), 0);
        assert!(clock::monotonic() >= until);
    }

    #[test]
    fn one_that_cannot_be_added_is_an_error() {
        let (set, a) = (WaitSet::new().unwrap(), WakeFd::new().unwrap());
        set.add(&a, 1).unwrap();
        assert_eq!(
            set.add(&a, 1).unwrap_err().raw_os_error(),
            Some(libc::EEXIST)
        );
    }
}
