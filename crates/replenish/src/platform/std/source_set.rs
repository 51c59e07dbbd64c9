//! [`SourceSet`]: the descriptors that a worker waits for beside its bell.
//! `source_set_disabled.rs` takes this file's place without feature `std`.

use crate::handoff::{Doorbell, Woken};
use crate::sync::{Arc, AtomicUsize, Notify, Ordering};
use core::fmt;
use replenish_os::{Nanos, SocketSet};
use std::io;
use std::os::fd::AsFd;

/// The key of the bell's descriptor: no handle has it.
const BELL: u32 = u32::MAX;

/// The descriptors that a worker waits for itself, beside its bell.
///
/// Samples that they bring are taken on its budget. A middleware adds those of its
/// [sources](crate::middleware::Middleware::source).
pub struct SourceSet {
    set: SocketSet,
    bell: Arc<Notify>,
    handles: AtomicUsize,
}

impl SourceSet {
    /// The set of the worker that `bell` wakes; `None` where no descriptor is free.
    pub(crate) fn new(bell: &Arc<Notify>) -> Option<Arc<Self>> {
        let set = SocketSet::new().ok()?;
        set.add(bell.descriptor().ok()?, BELL, true).ok()?;
        Some(Arc::new(Self {
            set,
            bell: Arc::clone(bell),
            handles: AtomicUsize::new(0),
        }))
    }

    /// Adds a descriptor of the handle with this key, which is [listened to](Self::listen) later.
    /// It leaves when it is closed.
    ///
    /// # Errors
    /// The errors of `epoll_ctl(2)`.
    pub fn add(&self, fd: &impl AsFd, key: u32) -> io::Result<()> {
        self.set.add(fd, key, false)
    }

    /// From now on the [source](crate::middleware::Source) is pulled when the descriptor is
    /// readable.
    ///
    /// # Errors
    /// `ENOENT` if it was not added.
    pub fn listen(&self, fd: &impl AsFd, key: u32) -> io::Result<()> {
        self.set.want(fd, key, true)
    }

    /// Number of handles whose samples come here.
    pub(crate) fn handles(&self) -> usize {
        self.handles.load(Ordering::Relaxed)
    }

    /// One more handle.
    pub(crate) fn join(&self) {
        self.handles.fetch_add(1, Ordering::Relaxed);
    }

    /// One handle less.
    pub(crate) fn leave(&self) {
        self.handles.fetch_sub(1, Ordering::Relaxed);
    }

    /// The worker sleeps until its bell rings, a descriptor is readable, or until `release`, and
    /// hears the keys of those that are.
    pub(crate) fn sleep<W: ?Sized>(
        &self,
        bell: &Doorbell<W>,
        release: Option<Nanos>,
        heard: &mut dyn FnMut(usize),
    ) -> Woken {
        bell.wait_elsewhere(release, || self.wait(release, heard))
    }

    /// Waits until the bell rings, a descriptor is readable, or until `deadline`, and tells the
    /// keys of those that are readable.
    pub(crate) fn wait(&self, deadline: Option<Nanos>, heard: &mut dyn FnMut(usize)) {
        let mut keys = [0; SocketSet::MOST];
        let Ok(count) = self.set.wait(deadline, &mut keys) else {
            return; // it was made for this: the bell rings, or the next wait is tried
        };
        for key in keys.into_iter().take(count) {
            if key != BELL {
                heard(usize::try_from(key).unwrap_or(usize::MAX));
            } else if let Ok(descriptor) = self.bell.descriptor() {
                descriptor.clear();
            }
        }
    }
}

impl fmt::Debug for SourceSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SourceSet").finish_non_exhaustive()
    }
}
