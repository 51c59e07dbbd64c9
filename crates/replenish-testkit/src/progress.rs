//! Lower bounds on progress, on a machine that may stand still.
//!
//! A thread that is held to a rate reaches that rate whenever the machine does its part. A trial
//! therefore looks for one stretch of time in which it did. A thread that is kept below its rate
//! has no such stretch.

use std::time::{Duration, Instant};

/// For so long such a stretch is looked for.
const PATIENCE: Duration = Duration::from_secs(30);

/// Whether `used`, a CPU time in ns, grows at `least` of a CPU in some stretch of this length.
///
/// The time between two readings is taken inside of them, so that a caller who is late does not
/// make the rate look smaller.
pub fn reaches(least: f64, length: Duration, mut used: impl FnMut() -> u64) -> bool {
    let (end, mut best) = (Instant::now() + PATIENCE, 0_f64);
    while Instant::now() < end {
        let before = used();
        let begun = Instant::now();
        std::thread::sleep(length);
        let took = begun.elapsed();
        let gain = Duration::from_nanos(used().saturating_sub(before));
        best = best.max(gain.as_secs_f64() / took.as_secs_f64());
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
