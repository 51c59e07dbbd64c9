//! The stop request: one flag, and a bell for each thread that may be asleep.
//!
//! ```text
//!   request: flag := true ──► lock bells, ring each
//!   join:    lock bells, add own ──► … ──► flag? ──► wait(bell) ──► flag? …
//! ```
//!
//! If the request locks the bells before a thread adds its own, the flag's store happens before
//! that thread's critical section, and it sees the flag before it waits. If after, its bell rings,
//! and a bell is sticky.

use crate::sync::{Arc, AtomicBool, Mutex, Notify, Ordering};
use alloc::vec::Vec;

/// Tells threads to end. Requesting is possible from any thread, any number of times.
#[derive(Default)]
pub struct Stop {
    requested: AtomicBool,
    bells: Mutex<Vec<Arc<Notify>>>,
}

impl Stop {
    /// No stop is requested, no thread has joined.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// From now on `bell` rings when a stop is requested. Set-up only: may allocate.
    #[inline]
    pub fn join(&self, bell: Arc<Notify>) {
        self.bells.lock().push(bell);
    }

    /// Asks all threads to end.
    pub fn request(&self) {
        self.requested.store(true, Ordering::Release);
        for bell in self.bells.lock().iter() {
            bell.set();
        }
    }

    /// Takes the request back, for threads that ask the flag alone: an ended thread stays ended.
    pub fn withdraw(&self) {
        self.requested.store(false, Ordering::Release);
    }

    /// Whether an end was asked for.
    pub fn is_requested(&self) -> bool {
        self.requested.load(Ordering::Acquire)
    }
}
