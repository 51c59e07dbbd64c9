//! When the enforcer is measured, when the baseline and when the bare timer: 0.4 s each, in turn,
//! with pauses that keep the RT throttle out.
//!
//! ```text
//!   0.0          0.4  0.5          0.9  1.0            1.4  1.5
//!    │◄ enforcer ─►│    │◄ baseline ─►│    │◄ bare timer ─►│    │◄ enforcer ─►│ …
//! ```

use crate::load::{MS, Nanos};

/// Priority of the workers and of the baseline's spinner.
pub(super) const WORKER_PRIORITY: u8 = 60;

/// A window.
const WINDOW: Nanos = 400 * MS;
/// From one window to the next one of another kind.
const TURN: Nanos = 500 * MS;
/// Sides that take turns.
const SIDES: usize = 3;

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
    /// `count` windows for each side from `epoch` on: the enforcer's, the baseline's and the bare
    /// timer's.
    pub(super) fn turns(epoch: Nanos, count: u64) -> [Self; SIDES] {
        let mut first = epoch;
        [(); SIDES].map(|()| {
            let side = Self { first, count };
            first += TURN;
            side
        })
    }

    /// The windows.
    pub(super) fn windows(self) -> impl Iterator<Item = Window> {
        (0..self.count).map(move |n| {
            let start = self.first + n * SIDES as Nanos * TURN;
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
        let sides = Schedule::turns(1_000, 3);
        let mut all: Vec<_> = sides.iter().flat_map(|s| s.windows()).collect();
        all.sort_by_key(|w| w.start);
        assert_eq!(all.len(), 9);
        for pair in all.windows(2) {
            assert_eq!(pair[1].start - pair[0].end, 100 * MS);
        }
        assert!(all.iter().all(|w| w.end - w.start == 400 * MS));
    }
}
