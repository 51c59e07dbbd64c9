//! A flag that any thread or signal handler raises and one worker takes: a guard condition's state.
//!
//! ```text
//!   raise: count += 1 ──► ring the bell          (two atomic operations, one futex call at most)
//!   worker: … ──► count := 0, > 0? run the callback : sleep on the bell ──► …
//! ```
//!
//! The count is raised before the bell rings, and a bell is sticky: a worker that has found the
//! count at 0 finds the bell rung when it goes to sleep.

use crate::sync::{AtomicU64, Ordering};

/// A sticky, counting flag.
pub struct Flag(AtomicU64);

impl Default for Flag {
    fn default() -> Self {
        Self::new()
    }
}

impl Flag {
    /// A flag that nobody has raised.
    #[must_use]
    pub fn new() -> Self {
        Self(AtomicU64::new(0))
    }

    /// Raises the flag, then rings.
    pub fn raise(&self, ring: impl FnOnce()) {
        self.0.fetch_add(1, Ordering::Release);
        ring();
    }

    /// Whether it was raised since it was last taken.
    pub fn is_raised(&self) -> bool {
        self.0.load(Ordering::Acquire) > 0
    }

    /// Lowers the flag; how often it was raised since it was last taken.
    pub fn take(&self) -> u64 {
        self.0.swap(0, Ordering::Acquire)
    }
}
