//! Lower bounds on progress, on a machine that may stand still.
//!
//! A thread that is held to a rate reaches that rate whenever the machine does its part. A trial
//! therefore looks for one stretch of time in which it did. A thread that is kept below its rate
//! has no such stretch.

use std::time::{Duration, Instant};

/// The longest search for such a stretch.
const PATIENCE: Duration = Duration::from_secs(30);

/// Whether `used`, a CPU time in ns, grows at `least` of a CPU in some stretch of this length.
///
/// The time is taken outside of the two readings: a reader that is late makes the rate look
/// smaller, and another stretch decides. Stretches of five periods see a budget that comes back a
/// quarter of its period late; in shorter ones the phase hides that.
pub fn reaches(least: f64, length: Duration, used: impl FnMut() -> u64) -> bool {
    reaches_within(PATIENCE, least, length, used)
}

fn reaches_within(
    patience: Duration,
    least: f64,
    length: Duration,
    mut used: impl FnMut() -> u64,
) -> bool {
    let (end, mut best) = (Instant::now() + patience, 0_f64);
    while Instant::now() < end {
        let (begun, before) = (Instant::now(), used());
        std::thread::sleep(length);
        let gain = Duration::from_nanos(used().saturating_sub(before));
        best = best.max(gain.as_secs_f64() / begun.elapsed().as_secs_f64());
        if best >= least {
            return true;
        }
    }
    eprintln!("at best {best:.4} of a CPU, {least:.4} expected, in stretches of {length:?}");
    false
}

/// Waits until `condition` holds; `false` after a minute.
#[must_use]
pub fn eventually(condition: impl Fn() -> bool) -> bool {
    let end = Instant::now() + Duration::from_secs(60);
    while !condition() {
        if Instant::now() > end {
            return false;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// A counter that runs at this rate, read without delay.
    fn at(rate: f64) -> impl FnMut() -> u64 {
        let begun = Instant::now();
        move || begun.elapsed().mul_f64(rate).as_nanos() as u64
    }

    #[test]
    fn a_rate_that_is_kept_below_the_least_is_never_reached() {
        assert!(!reaches_within(300 * MS, 0.5, 30 * MS, at(0.4)));
    }

    #[test]
    fn one_good_stretch_is_enough() {
        assert!(reaches(0.5, 5 * MS, at(0.6)));
        // The counter stands still for a while first.
        let (mut full, begun) = (at(1.0), Instant::now());
        let late = move || {
            if begun.elapsed() < 50 * MS { 0 } else { full() }
        };
        assert!(reaches(0.9, 10 * MS, late));
    }
}
