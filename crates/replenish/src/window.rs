//! Mean, deviation and extremes of the values since the last look: written by one thread without a
//! lock or a locked instruction, read by one other thread.
//!
//! A value that is recorded while the reader looks may count in one window and add to the next.

use crate::Nanos;
use crate::platform::FULL;
use crate::sync::{Ordering, unmodelled::AtomicU64};

/// Words of a window; none in builds that have no room for them.
const WORDS: usize = if FULL { 8 } else { 0 };
/// Squares are those of units of 64 ns: a second of callbacks of 30 s fits into 64 bits.
const UNIT: u32 = 6;

/// A window that is being written.
///
/// Count, sum and sum of squares grow for ever; the reader keeps the values of its last look. The
/// extremes are taken by the reader: the largest value, and the largest complement.
#[derive(Default)]
pub(crate) struct LiveWindow {
    words: [AtomicU64; WORDS],
}

/// The values of a window, in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Window {
    pub(crate) count: u64,
    pub(crate) average: f64,
    pub(crate) min: Nanos,
    pub(crate) max: Nanos,
    pub(crate) variance: f64,
}

/// Adds to the word; to be called by its one writer.
fn add(word: &AtomicU64, value: u64) {
    let sum = word.load(Ordering::Relaxed).wrapping_add(value);
    word.store(sum, Ordering::Relaxed);
}

fn raise(word: &AtomicU64, value: u64) {
    if value > word.load(Ordering::Relaxed) {
        word.fetch_max(value, Ordering::Relaxed);
    }
}

/// Growth of the word since `seen`, which it brings up to date.
fn growth(word: &AtomicU64, seen: &AtomicU64) -> u64 {
    let now = word.load(Ordering::Relaxed);
    now.wrapping_sub(seen.swap(now, Ordering::Relaxed))
}

impl LiveWindow {
    /// Adds one more value; one thread at a time.
    #[inline]
    pub(crate) fn record(&self, value: Nanos) {
        let [count, sum, squares, max, unmin, ..] = &self.words[..] else {
            return;
        };
        let units = value >> UNIT;
        add(sum, value);
        add(squares, units.saturating_mul(units));
        raise(max, value);
        raise(unmin, !value);
        add(count, 1);
    }

    /// The values since the last call: for one reader.
    #[allow(dead_code, reason = "nobody publishes it without feature `std`")]
    pub(crate) fn take(&self) -> Window {
        let [count, sum, squares, max, unmin, seen @ ..] = &self.words[..] else {
            return Window::default();
        };
        let [seen_count, seen_sum, seen_squares] = seen else {
            return Window::default();
        };
        let count = growth(count, seen_count);
        let (sum, squares) = (growth(sum, seen_sum), growth(squares, seen_squares));
        let (max, unmin) = [max, unmin]
            .map(|word| word.swap(0, Ordering::Relaxed))
            .into();
        if count == 0 {
            return Window::default();
        }
        let average = sum as f64 / count as f64;
        let unit = f64::from(1_u32 << UNIT);
        let in_units = average / unit;
        let variance = squares as f64 / count as f64 - in_units * in_units;
        Window {
            count,
            average,
            min: !unmin,
            max,
            variance: variance.max(0.0) * unit * unit,
        }
    }
}
