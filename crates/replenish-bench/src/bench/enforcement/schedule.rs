//! When the enforcer is measured and when the baseline: 0.4 s each, in turn, with pauses that keep
//! the RT throttle out.
//!
//! ```text
//!   0.0          0.4  0.5          0.9  1.0
//!    │◄ enforcer ─►│    │◄ baseline ─►│    │◄ enforcer ─►│ …
//! ```

use crate::load::{MS, Nanos};

/// Priority of the workers and of the baseline's spinner.
pub(super) const WORKER_PRIORITY: u8 = 60;

/// A window.
const WINDOW: Nanos = 400 * MS;
/// From one window to the next one of the other kind.
const HALF: Nanos = 500 * MS;

/// The windows of one side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Schedule {
    first: Nanos,
    count: u64,
}

/// One window, on `CLOCK_MONOTONIC`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Window {
    /// Its start.
    pub start: Nanos,
    /// Its end.
    pub end: Nanos,
}

impl Schedule {
    /// `count` windows for each side from `epoch` on: the enforcer's and the baseline's.
    pub(super) fn pair(epoch: Nanos, count: u64) -> (Self, Self) {
        (
            Self {
                first: epoch,
                count,
            },
            Self {
                first: epoch + HALF,
                count,
            },
        )
    }

    /// The windows.
    pub(super) fn windows(self) -> impl Iterator<Item = Window> {
        (0..self.count).map(move |n| {
            let start = self.first + n * 2 * HALF;
            Window {
                start,
                end: start + WINDOW,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sides_take_turns() {
        let (a, b) = Schedule::pair(1_000, 3);
        let mut all: Vec<_> = a.windows().chain(b.windows()).collect();
        all.sort_by_key(|w| w.start);
        assert_eq!(all.len(), 6);
        for pair in all.windows(2) {
            assert_eq!(pair[1].start - pair[0].end, 100 * MS);
        }
        assert!(all.iter().all(|w| w.end - w.start == 400 * MS));
    }
}
