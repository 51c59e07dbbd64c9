//! Latency histograms of fixed size: written by one thread without a lock, read by any.
//!
//! Buckets are a quarter of an octave wide, from 1 us to 34 s: a percentile read from them is at
//! most a quarter above the true value. 102 words, allocated with the handle, never more.

use crate::Nanos;
use crate::platform::FULL;
use crate::sync::{Ordering, unmodelled::AtomicU64};
use crate::window::{LiveWindow, Window};

/// Buckets of a histogram; none in builds that have no room for them.
const BUCKETS: usize = if FULL { 102 } else { 0 };
/// Values below 2^10 ns share the first bucket.
const FIRST: u32 = 10;

/// A histogram that is being written.
pub(crate) struct LiveHistogram {
    counts: [AtomicU64; BUCKETS],
    window: LiveWindow,
}

impl Default for LiveHistogram {
    fn default() -> Self {
        Self {
            counts: core::array::from_fn(|_| AtomicU64::new(0)),
            window: LiveWindow::default(),
        }
    }
}

impl LiveHistogram {
    /// Counts one value; returns its bucket.
    pub(crate) fn record(&self, value: Nanos) -> usize {
        let bucket = bucket(value);
        if let Some(count) = self.counts.get(bucket) {
            count.fetch_add(1, Ordering::Relaxed);
            self.window.record(value);
        }
        bucket
    }

    pub(crate) fn snapshot(&self) -> Histogram {
        let counts = core::array::from_fn(|i| {
            let count = self.counts.get(i);
            count.map_or(0, |c| c.load(Ordering::Relaxed))
        });
        Histogram { counts }
    }

    /// The values since the last call: for one reader.
    #[allow(dead_code, reason = "nobody publishes it without feature `std`")]
    pub(crate) fn take_window(&self) -> Window {
        self.window.take()
    }
}

/// Counts of latencies, by size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Histogram {
    counts: [u64; BUCKETS],
}

impl Histogram {
    /// Number of values in it.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// The value in nanoseconds that `percent` (0..=100) of all values do not exceed, rounded up
    /// to the end of its bucket; 0 if there are none.
    #[must_use]
    pub fn percentile(&self, percent: u8) -> Nanos {
        let total = u128::from(self.count());
        let rank = (total * u128::from(percent.min(100))).div_ceil(100).max(1);
        let mut seen = 0;
        for (i, count) in self.counts.iter().enumerate() {
            seen += u128::from(*count);
            if seen >= rank {
                return upper(i);
            }
        }
        0
    }

    /// The buckets that are not empty: the largest value that belongs to each, in nanoseconds
    /// (`u64::MAX` for the last), and how many values it holds.
    pub fn buckets(&self) -> impl Iterator<Item = (Nanos, u64)> + '_ {
        let all = self.counts.iter().enumerate();
        all.filter(|(_, n)| **n > 0).map(|(i, n)| (upper(i), *n))
    }
}

fn bucket(value: Nanos) -> usize {
    let Some(octave) = value.checked_ilog2().filter(|o| *o >= FIRST) else {
        return 0;
    };
    let quarter = (value >> (octave - 2)) & 3;
    let index = u64::from(octave - FIRST) * 4 + quarter + 1;
    usize::try_from(index)
        .unwrap_or(BUCKETS)
        .min(BUCKETS.saturating_sub(1))
}

fn upper(bucket: usize) -> Nanos {
    if BUCKETS.saturating_sub(bucket) <= 1 {
        return Nanos::MAX;
    }
    // The next bucket's first value, less one.
    let (octave, quarter) = (bucket / 4, bucket as u64 % 4);
    ((4 + quarter) << (octave + FIRST as usize - 2)) - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_is_in_the_bucket_whose_bounds_enclose_it() {
        let edges = (0..64).flat_map(|s| [(1_u64 << s) - 1, 1 << s, (1 << s) + (1 << s) / 3]);
        for value in edges.chain([u64::MAX]) {
            let at = bucket(value);
            assert!(value <= upper(at), "{value} in {at}");
            assert!(at == 0 || value > upper(at - 1), "{value} in {at}");
        }
    }

    #[test]
    fn percentiles_are_a_quarter_too_high_at_most() {
        let live = LiveHistogram::default();
        for value in 1..=1000_u64 {
            live.record(value * 1000);
        }
        let h = live.snapshot();
        assert_eq!(h.count(), 1000);
        for percent in [1, 50, 90, 99, 100] {
            let exact = u64::from(percent) * 10_000;
            let got = h.percentile(percent);
            assert!((exact..exact + exact / 4 + 1024).contains(&got), "{got}");
        }
        assert_eq!(LiveHistogram::default().snapshot().percentile(99), 0);
    }

    #[test]
    fn a_window_holds_the_values_since_the_last_look() {
        let live = LiveWindow::default();
        assert_eq!(live.take(), Window::default());
        for _ in 0..2 {
            (1..=9_u64).for_each(|n| live.record(n * 1_000_000));
            let seen = live.take();
            assert_eq!((seen.count, seen.min, seen.max), (9, 1_000_000, 9_000_000));
            assert!((seen.average - 5e6).abs() < 1.0, "{seen:?}");
            // (4² + 3² + 2² + 1²) · 2 / 9 ms²
            assert!(
                (seen.variance.sqrt() - 2_581_988.9).abs() < 100.0,
                "{seen:?}"
            );
        }
        assert_eq!(live.take().count, 0);
    }

    #[test]
    fn the_longest_values_leave_mean_and_extremes_right() {
        let live = LiveWindow::default();
        let long = 34_000_000_000;
        (0..100).for_each(|_| live.record(long));
        let seen = live.take();
        assert_eq!((seen.count, seen.min, seen.max), (100, long, long));
        assert!(seen.variance.sqrt() < 1000.0, "{seen:?}");
    }
}
