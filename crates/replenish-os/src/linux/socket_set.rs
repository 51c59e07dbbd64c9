//! Waiting on many descriptors, of which some are of no interest for a while.

use super::wait_set::{NO_EVENT, ready};
use crate::Nanos;
use rustix::event::epoll::{self, CreateFlags, EventData, EventFlags};
use std::io;
use std::os::fd::{AsFd, OwnedFd};

/// Descriptors to be read from (`epoll(7)`, level-triggered), each with a key of its own, each
/// wanted or not.
///
/// A descriptor that is not wanted never ends a wait: its bytes stay in the kernel, which drops
/// further ones. A closed descriptor leaves the set by itself. Any thread may call any method.
#[derive(Debug)]
pub struct SocketSet(OwnedFd);

impl SocketSet {
    /// Keys that one [`wait`](Self::wait) gives at most; the others come with the next one.
    pub const MOST: usize = 64;

    /// An empty set; closed on `exec`.
    ///
    /// # Errors
    /// `EMFILE` or `ENFILE` when no descriptor is free, `ENOMEM`.
    pub fn new() -> io::Result<Self> {
        Ok(Self(epoll::create(CreateFlags::CLOEXEC)?))
    }

    /// Adds a descriptor.
    ///
    /// # Errors
    /// `EEXIST` if it is there already, `EPERM` for one that cannot be waited on, `ENOMEM`,
    /// `ENOSPC`; see `epoll_ctl(2)`.
    pub fn add(&self, fd: &impl AsFd, key: u32, wanted: bool) -> io::Result<()> {
        let key = EventData::new_u64(key.into());
        Ok(epoll::add(&self.0, fd, key, flags(wanted))?)
    }

    /// Says whether a descriptor that was added is wanted from now on.
    ///
    /// # Errors
    /// `ENOENT` if it was not added; see `epoll_ctl(2)`.
    pub fn want(&self, fd: &impl AsFd, key: u32, wanted: bool) -> io::Result<()> {
        let key = EventData::new_u64(key.into());
        Ok(epoll::modify(&self.0, fd, key, flags(wanted))?)
    }

    /// Takes a descriptor out.
    ///
    /// # Errors
    /// `ENOENT` if it was not added; see `epoll_ctl(2)`.
    pub fn remove(&self, fd: &impl AsFd) -> io::Result<()> {
        Ok(epoll::delete(&self.0, fd)?)
    }

    /// Waits until a wanted descriptor is ready or [`monotonic`](crate::clock::monotonic) time has
    /// reached `deadline` (`None`: for ever); puts the keys of those that are ready into `keys` and
    /// returns how many. No allocation; signals do not end the wait.
    ///
    /// # Errors
    /// The errors of [`poll`](crate::poll()).
    pub fn wait(&self, deadline: Option<Nanos>, keys: &mut [u32; Self::MOST]) -> io::Result<usize> {
        let mut events = [NO_EVENT; Self::MOST];
        let ready = ready(&self.0, &mut events, deadline)?;
        let pairs = keys.iter_mut().zip(ready);
        let store = |(to, key): (&mut u32, u64)| *to = u32::try_from(key).unwrap_or(u32::MAX);
        Ok(pairs.map(store).count())
    }
}

fn flags(wanted: bool) -> EventFlags {
    if wanted {
        EventFlags::IN
    } else {
        EventFlags::empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::WakeFd;

    #[test]
    fn those_that_are_not_wanted_end_no_wait() {
        let (set, a, b) = (
            SocketSet::new().unwrap(),
            WakeFd::new().unwrap(),
            WakeFd::new().unwrap(),
        );
        set.add(&a, 7, true).unwrap();
        set.add(&b, 900, false).unwrap();
        let mut keys = [0; SocketSet::MOST];
        b.wake();
        assert_eq!(set.wait(Some(0), &mut keys).unwrap(), 0);
        set.want(&b, 900, true).unwrap();
        assert_eq!(set.wait(None, &mut keys).unwrap(), 1);
        assert_eq!(keys[0], 900);
        a.wake();
        set.want(&b, 900, false).unwrap();
        assert_eq!(set.wait(None, &mut keys).unwrap(), 1);
        assert_eq!(keys[0], 7);
        drop(b);
        a.clear();
        assert_eq!(set.wait(Some(0), &mut keys).unwrap(), 0);
    }
}
