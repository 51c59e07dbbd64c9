//! Waiting on the same descriptors again and again, at the price of one system call that does not
//! look at each of them.
#![expect(
    unsafe_code,
    reason = "epoll_pwait2, which rustix calls for whole milliseconds only"
)]

use super::clock::monotonic;
use super::poll::{PollFd, poll};
use super::sys;
use crate::Nanos;
use rustix::event::epoll::{self, CreateFlags, EventData, EventFlags};
use std::io;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
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
        Ok(Self(epoll::create(CreateFlags::CLOEXEC)?))
    }

    /// Adds `fd`: [`wait`](Self::wait) then ends when it can be read, or is broken, and returns
    /// `bits`.
    ///
    /// # Errors
    /// `EEXIST` if it is there already, `EPERM` for a descriptor that cannot be waited on,
    /// `ENOMEM`, `ENOSPC`; see `epoll_ctl(2)`.
    pub fn add(&self, fd: &impl AsFd, bits: u32) -> io::Result<()> {
        let bits = EventData::new_u64(bits.into());
        Ok(epoll::add(&self.0, fd, bits, EventFlags::IN)?)
    }

    /// Waits until a descriptor is ready or [`monotonic`](crate::clock::monotonic) time has reached
    /// `deadline` (`None`: for ever), as [`poll`] does. Returns the bits of those that are ready,
    /// of four of them at most; 0 means that the deadline passed. No allocation; signals do not end
    /// the wait.
    ///
    /// # Errors
    /// The errors of [`poll`].
    pub fn wait(&self, deadline: Option<Nanos>) -> io::Result<u32> {
        let mut events = [NO_EVENT; Self::MOST];
        let ready = ready(&self.0, &mut events, deadline)?;
        let bits = |bits, key: u64| bits | u32::try_from(key).unwrap_or(0);
        Ok(ready.fold(0, bits))
    }
}

/// An event of which nothing is known yet.
pub(super) const NO_EVENT: libc::epoll_event = libc::epoll_event { events: 0, u64: 0 };

/// Waits until a descriptor of `set` is ready or `deadline` is reached; the keys of those that are,
/// as many as `events` has room for. Signals do not end the wait.
pub(super) fn ready<'e>(
    set: &OwnedFd,
    events: &'e mut [libc::epoll_event],
    deadline: Option<Nanos>,
) -> io::Result<impl Iterator<Item = u64> + use<'e>> {
    let count = match epoll_pwait2(set, events, deadline) {
        // Before Linux 5.11. The set itself can be waited on, to the nanosecond.
        Err(e) if e.raw_os_error() == Some(libc::ENOSYS) => {
            poll(&mut [PollFd::readable(set)], deadline)?;
            epoll_pwait2(set, events, Some(0))
        }
        count => count,
    }?;
    Ok(events.iter().take(count).map(|e| e.u64))
}

fn epoll_pwait2(
    set: &OwnedFd,
    events: &mut [libc::epoll_event],
    deadline: Option<Nanos>,
) -> io::Result<usize> {
    let (set, room, to) = (set.as_raw_fd(), events.len(), events.as_mut_ptr());
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
    Ok(usize::try_from(ready).unwrap_or(0))
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
