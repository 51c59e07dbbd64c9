//! Pong's notes about each message: the simulator replays the real arrivals.
//!
//! The workers write the notes. They are read when the workers have ended.

use crate::load::Nanos;
use crate::load::grid::Grid;
use crate::load::simulated::Arrivals;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

/// Messages of a topic that are noted; those of later windows are not.
const MESSAGES: usize = 1 << 14;
/// Wake-ups that are kept: the last ones.
const WAKE_UPS: usize = 512;

/// One topic's notes. Writing neither allocates nor waits.
#[derive(Debug)]
pub(super) struct Timing {
    /// From sending to taking, in ns, window by window; 0: not seen.
    taken: Box<[AtomicU32]>,
    /// Delays with which callbacks woke from their sleep.
    wake_ups: [AtomicU64; WAKE_UPS],
    woken: AtomicU64,
}

impl Timing {
    pub(super) fn new() -> Self {
        Self {
            taken: (0..MESSAGES).map(|_| AtomicU32::new(0)).collect(),
            wake_ups: [const { AtomicU64::new(0) }; WAKE_UPS],
            woken: AtomicU64::new(0),
        }
    }

    /// Message `place` of window `index` was taken `after` its sending.
    pub(super) fn taken(&self, grid: &Grid, index: u64, place: u64, after: Nanos) {
        let slot = index.saturating_mul(grid.messages()).saturating_add(place);
        let slot = usize::try_from(slot).ok().and_then(|s| self.taken.get(s));
        if let Some(slot) = slot {
            let after = u32::try_from(after).unwrap_or(u32::MAX).max(1);
            slot.store(after, Ordering::Relaxed);
        }
    }

    /// Notes a callback that woke `late` ns after the time it asked for.
    pub(super) fn woke(&self, late: Nanos) {
        let n = self.woken.fetch_add(1, Ordering::Relaxed);
        let slot = usize::try_from(n % WAKE_UPS as u64).unwrap_or(0);
        self.wake_ups[slot].store(late, Ordering::Relaxed);
    }

    /// The median lateness of a wake-up; 0 if there was none.
    pub(super) fn wake_up(&self) -> Nanos {
        let kept = usize::try_from(self.woken.load(Ordering::Relaxed)).unwrap_or(WAKE_UPS);
        let kept = self.wake_ups.iter().take(kept);
        let mut late: Vec<_> = kept.map(|l| l.load(Ordering::Relaxed)).collect();
        late.sort_unstable();
        late.get(late.len() / 2).copied().unwrap_or(0)
    }

    /// Times at which the messages of each window were taken.
    pub(super) fn arrivals(&self, grid: &Grid) -> Arrivals {
        let messages = usize::try_from(grid.messages().max(1)).unwrap_or(MESSAGES);
        let of = |window: &[AtomicU32]| window.iter().map(|t| t.load(Ordering::Relaxed)).collect();
        let mut windows: Vec<Vec<u32>> = self.taken.chunks_exact(messages).map(of).collect();
        let used = windows.iter().rposition(|w| w.iter().any(|t| *t > 0));
        windows.truncate(used.map_or(0, |last| last + 1));
        Arrivals(windows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::MS;

    #[test]
    fn windows_come_back_as_they_were_noted_and_what_is_beyond_is_left_out() {
        let grid = Grid::windowed(0, 100 * MS, 10 * MS);
        let timing = Timing::new();
        assert_eq!(timing.arrivals(&grid), Arrivals(Vec::new()));
        timing.taken(&grid, 1, 39, 70_000);
        timing.taken(&grid, 1, 0, 0);
        timing.taken(&grid, u64::MAX, 0, 1);
        let Arrivals(windows) = timing.arrivals(&grid);
        assert_eq!(windows.len(), 2);
        assert!(windows[0].iter().all(|t| *t == 0));
        assert_eq!(
            (windows[1][0], windows[1][1], windows[1][39]),
            (1, 0, 70_000)
        );
    }

    #[test]
    fn a_wake_up_is_the_median_of_the_last_ones() {
        let timing = Timing::new();
        assert_eq!(timing.wake_up(), 0);
        for late in [9, 1, 5] {
            timing.woke(late);
        }
        assert_eq!(timing.wake_up(), 5);
        (0..WAKE_UPS).for_each(|_| timing.woke(3));
        assert_eq!(timing.wake_up(), 3);
    }
}
