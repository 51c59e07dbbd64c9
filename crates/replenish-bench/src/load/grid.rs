//! Windows of load on an absolute `CLOCK_MONOTONIC` grid.
//!
//! ```text
//!   epoch          +W            +W+P          +2W+P
//!     │◄── window 0 ─►│◄─ pause ──►│◄── window 1 ─►│◄─ pause ─ …
//!     ▲  ▲  ▲  ▲  ▲     backlog is    first message of both
//!     messages every 10 ms  discarded   topics at its start
//! ```
//!
//! Why windows: the kernel lets real-time threads have 95 % of each second and then stops them
//! all for 50 ms. A load that keeps a CPU busy without a break would measure that throttle.
//! With pauses it stays out, and because a pause lasts at least one period, every budget is full
//! again when the next window starts.

use super::{MS, Nanos, SEC};

/// A window lasts about this long; see [`Grid::windowed`].
const TARGET_WINDOW: Nanos = 400 * MS;

/// A pause lasts at least this long.
const MIN_PAUSE: Nanos = 100 * MS;

/// Position of an instant on the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    /// Before the epoch or inside a pause: no load is offered, a backlog is discarded.
    Outside,
    /// Inside a window.
    Window {
        /// The number of the window, from 0.
        index: u64,
        /// Time at which work in this window must stop; [`Nanos::MAX`] when load is continuous.
        end: Nanos,
    },
}

/// The grid: when load is offered. Copied to every process of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Grid {
    /// Start of window 0, `CLOCK_MONOTONIC`.
    pub epoch: Nanos,
    /// Length of a window.
    pub window: Nanos,
    /// Length of a pause; 0 means that load is offered all the time.
    pub pause: Nanos,
    /// Time between two messages of one topic.
    pub interval: Nanos,
}

impl Grid {
    /// The grid for budgets of period `period`: windows of 0.4 s rounded to a whole number of
    /// periods (at least one), pauses of 0.1 s or one period, whichever is longer.
    pub(crate) fn windowed(epoch: Nanos, period: Nanos, interval: Nanos) -> Self {
        let period = period.max(1);
        let periods = ((TARGET_WINDOW + period / 2) / period).max(1);
        Self {
            epoch,
            window: periods * period,
            pause: MIN_PAUSE.max(period),
            interval,
        }
    }

    /// The grid without pauses: windows are then only a raster for reports.
    pub(crate) fn continuous(epoch: Nanos, interval: Nanos) -> Self {
        Self {
            epoch,
            window: SEC,
            pause: 0,
            interval,
        }
    }

    /// Whether load is offered all the time.
    pub(crate) fn is_continuous(&self) -> bool {
        self.pause == 0
    }

    /// From the start of a window to the start of the next one.
    pub(crate) fn cycle(&self) -> Nanos {
        (self.window + self.pause).max(1)
    }

    /// Start of window `index`.
    pub(crate) fn start(&self, index: u64) -> Nanos {
        self.epoch
            .saturating_add(index.saturating_mul(self.cycle()))
    }

    /// End of window `index`.
    pub(crate) fn end(&self, index: u64) -> Nanos {
        self.start(index).saturating_add(self.window)
    }

    /// Messages of one topic in a window: one at its start and then every interval.
    pub(crate) fn messages(&self) -> u64 {
        self.window.div_ceil(self.interval.max(1))
    }

    /// Time at which message `i` of window `index` is sent.
    pub(crate) fn release(&self, index: u64, i: u64) -> Nanos {
        self.start(index)
            .saturating_add(i.saturating_mul(self.interval))
    }

    /// Position of `now` on the grid.
    pub(crate) fn locate(&self, now: Nanos) -> Place {
        let Some(since) = now.checked_sub(self.epoch) else {
            return Place::Outside;
        };
        let index = since / self.cycle();
        if since % self.cycle() >= self.window {
            return Place::Outside;
        }
        let end = if self.is_continuous() {
            Nanos::MAX
        } else {
            self.end(index)
        };
        Place::Window { index, end }
    }
}

/// Message numbers: the window and the place in it, in one `i32`.
///
/// Both sides can then tell a message of this window from one that is late.
const PER_WINDOW: u64 = 1_000;

/// The number of message `i` of window `index`; wraps after two million windows.
pub(crate) fn number(index: u64, i: u64) -> i32 {
    let wrapped = index % (u64::from(i32::MAX.unsigned_abs()) / PER_WINDOW);
    i32::try_from(wrapped * PER_WINDOW + i % PER_WINDOW).unwrap_or(0)
}

/// The window that a message number names (modulo the wrap of [`number`]).
pub(crate) fn window_of(number: i32) -> Option<u64> {
    u64::try_from(number).ok().map(|n| n / PER_WINDOW)
}

/// The place in its window that a message number names.
pub(crate) fn place_of(number: i32) -> u64 {
    u64::try_from(number).map_or(0, |n| n % PER_WINDOW)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_is_a_whole_number_of_periods() {
        for (period, window, pause) in [
            (100, 400, 100),
            (90, 360, 100),
            (7, 399, 100),
            (300, 300, 300),
        ] {
            let g = Grid::windowed(0, period * MS, 10 * MS);
            assert_eq!(
                (g.window / MS, g.pause / MS),
                (window, pause),
                "period {period}"
            );
            assert_eq!(g.window % (period * MS), 0);
        }
    }

    #[test]
    fn no_period_up_to_900_ms_can_reach_the_rt_throttle() {
        for period in 2..=900 {
            let g = Grid::windowed(0, period * MS, 10 * MS);
            // The throttle looks at whole seconds at an unknown phase.
            let mut worst = 0;
            for phase in (0..g.cycle()).step_by(usize::try_from(5 * MS).unwrap()) {
                let busy = |t: Nanos| (t / g.cycle()) * g.window + (t % g.cycle()).min(g.window);
                worst = worst.max(busy(phase + SEC) - busy(phase));
            }
            assert!(
                worst < 950 * MS,
                "period {period} ms: {} ms busy",
                worst / MS
            );
        }
    }

    #[test]
    fn places_and_releases_agree() {
        let g = Grid::windowed(5 * SEC, 100 * MS, 10 * MS);
        assert_eq!(g.locate(5 * SEC - 1), Place::Outside);
        assert_eq!(
            g.locate(g.release(3, 39)),
            Place::Window {
                index: 3,
                end: g.end(3)
            }
        );
        assert_eq!(g.locate(g.end(3)), Place::Outside);
        assert_eq!(g.messages(), 40);
        assert_eq!(Grid::windowed(0, 7 * MS, 10 * MS).messages(), 40); // 399 ms: 0, 10, … 390
    }

    #[test]
    fn continuous_load_has_no_end() {
        let g = Grid::continuous(SEC, 10 * MS);
        assert_eq!(
            g.locate(3 * SEC),
            Place::Window {
                index: 2,
                end: Nanos::MAX
            }
        );
        assert_eq!(g.end(1), g.start(2));
    }

    #[test]
    fn numbers_name_their_window() {
        assert_eq!(window_of(number(17, 39)), Some(17));
        assert_eq!(place_of(number(17, 39)), 39);
        assert_eq!(window_of(-1), None);
        assert!(number(u64::MAX, 5) >= 0);
    }
}
