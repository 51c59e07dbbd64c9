//! The flags of a session that are read without its lock.

use crate::sync::{AtomicBool, AtomicUsize, Ordering};

/// Read without the lock, written under it.
#[derive(Debug, Default)]
pub(super) struct StatusFlags {
    /// The session is up.
    up: AtomicBool,
    /// Samples wait here.
    backlog: AtomicBool,
    /// The agent has told of endpoints that do not fit.
    clash: AtomicBool,
    /// Changes of `up` and `clash`.
    news: AtomicUsize,
}

impl StatusFlags {
    pub(super) fn is_up(&self) -> bool {
        self.up.load(Ordering::Acquire)
    }

    pub(super) fn has_backlog(&self) -> bool {
        self.backlog.load(Ordering::Acquire)
    }

    pub(super) fn has_clash(&self) -> bool {
        self.clash.load(Ordering::Acquire)
    }

    pub(super) fn status_generation(&self) -> usize {
        self.news.load(Ordering::Acquire)
    }

    pub(super) fn show_backlog(&self, any: bool) {
        self.backlog.store(any, Ordering::Release);
    }

    pub(super) fn show_link(&self, up: bool) {
        self.show(&self.up, up);
    }

    pub(super) fn show_clash(&self, any: bool) {
        self.show(&self.clash, any);
    }

    fn show(&self, what: &AtomicBool, value: bool) {
        if what.swap(value, Ordering::Release) != value {
            self.news.fetch_add(1, Ordering::Release);
        }
    }
}
