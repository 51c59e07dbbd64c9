//! The least that can wake a thread; `replenish bench handoff` measures against it.

use super::futex;
use std::sync::atomic::{AtomicU32, Ordering};

const EMPTY: u32 = 0;
const SET: u32 = 1;

/// The least wake-up: one word, a system call for each wake, no deadline.
///
/// One thread may wait at a time; what was written before [`set`](Self::set) is visible after the
/// wait that it ends.
#[derive(Debug, Default)]
pub struct BareFutex(AtomicU32);

impl BareFutex {
    /// A word that is not set.
    #[must_use]
    pub const fn new() -> Self {
        Self(AtomicU32::new(EMPTY))
    }

    /// Sets the word and wakes the waiter.
    pub fn set(&self) {
        self.0.store(SET, Ordering::Release);
        futex::wake_one(&self.0);
    }

    /// Waits until the word is set and clears it.
    pub fn wait(&self) {
        while self.0.swap(EMPTY, Ordering::Acquire) == EMPTY {
            futex::wait(&self.0, EMPTY, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn every_set_is_answered() {
        let there = Arc::new(BareFutex::new());
        let back = Arc::new(BareFutex::new());
        let (a, b) = (Arc::clone(&there), Arc::clone(&back));
        let echo = std::thread::spawn(move || {
            for _ in 0..1_000 {
                a.wait();
                b.set();
            }
        });
        for _ in 0..1_000 {
            there.set();
            back.wait();
        }
        echo.join().unwrap();
    }
}
