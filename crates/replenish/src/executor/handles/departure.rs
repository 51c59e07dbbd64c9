//! The end of a handle: its worker and the dispatcher let go of it, each on its own thread.
//! `departure_disabled.rs` takes this file's place in builds without feature `full`.

use crate::sync::{AtomicBool, Notify, Ordering};

/// The threads that have let go of a handle that was removed.
pub(crate) struct Departure {
    /// Set when the worker has let go of it.
    pub(crate) gone: Notify,
    unrouted: AtomicBool,
}

impl Departure {
    pub(crate) fn new() -> Self {
        Self {
            gone: Notify::new(),
            unrouted: AtomicBool::new(false),
        }
    }

    /// Dispatcher: it brings the handle nothing any more.
    pub(crate) fn unroute(&self) {
        self.unrouted.store(true, Ordering::Release);
    }

    /// Whether the dispatcher brings it nothing any more.
    pub(crate) fn is_unrouted(&self) -> bool {
        self.unrouted.load(Ordering::Acquire)
    }
}
