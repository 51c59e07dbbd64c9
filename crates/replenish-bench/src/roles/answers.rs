//! Ping's account: what was sent and what came back, per window or in total.

use crate::load::grid;
use std::sync::atomic::{AtomicU64, Ordering};

/// Windows whose answers are counted apart at the same time.
const KEPT: usize = 8;

/// Counts answers by the window that their number names. Any thread may count and read.
#[derive(Debug, Default)]
pub(crate) struct Answers {
    /// Per kept window: its number + 1 and its count.
    slots: [(AtomicU64, AtomicU64); KEPT],
    total: AtomicU64,
}

impl Answers {
    /// Counts an answer.
    pub(crate) fn count(&self, number: i32) {
        self.total.fetch_add(1, Ordering::Relaxed);
        let Some(window) = grid::window_of(number) else {
            return;
        };
        if let Some((tag, count)) = self.slot(window)
            && tag.load(Ordering::Acquire) == window + 1
        {
            count.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Starts to count answers of `window`, in the place of one long past.
    pub(crate) fn open(&self, window: u64) {
        if let Some((tag, count)) = self.slot(window) {
            tag.store(0, Ordering::Release);
            count.store(0, Ordering::Relaxed);
            tag.store(window + 1, Ordering::Release);
        }
    }

    /// Answers of `window` so far.
    pub(crate) fn of(&self, window: u64) -> u64 {
        self.slot(window)
            .map_or(0, |(_, count)| count.load(Ordering::Relaxed))
    }

    /// All answers so far.
    pub(crate) fn total(&self) -> u64 {
        self.total.load(Ordering::Relaxed)
    }

    fn slot(&self, window: u64) -> Option<&(AtomicU64, AtomicU64)> {
        self.slots.get(usize::try_from(window % KEPT as u64).ok()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_count_for_their_own_window_only() {
        let a = Answers::default();
        a.open(3);
        a.count(grid::number(3, 0));
        a.count(grid::number(3, 39));
        a.count(grid::number(2, 39)); // late, from a window that was never opened
        a.count(-1);
        assert_eq!((a.of(3), a.total()), (2, 4));
        a.open(3 + KEPT as u64);
        assert_eq!(a.of(3 + KEPT as u64), 0);
        a.count(grid::number(3, 1)); // its place has been taken
        assert_eq!(a.of(3 + KEPT as u64), 0);
    }
}
