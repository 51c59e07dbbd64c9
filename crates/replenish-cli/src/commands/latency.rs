//! Delay with which a thread wakes from an absolute sleep: the floor under every latency on this
//! machine.

use crate::machine::stats::{Sorted, us};
use crate::outcome::Failure;
use crate::time::{MS, Nanos, SEC};
use replenish_os::{Policy, ThreadSpec, clock, current_tid, granted, spawn};

/// Length of each sleep, in ns.
const INTERVAL: Nanos = MS;

/// Lateness in ns that shows a standstill of the machine, as virtual ones have.
const STALL: i64 = 1_000_000;

/// Upper ends of the histogram's classes, in microseconds; the last one is open.
const CLASSES: [i64; 11] = [
    5,
    10,
    20,
    30,
    50,
    100,
    200,
    500,
    1_000,
    5_000,
    i64::MAX / 1_000,
];

/// Wake-up latencies of one thread.
#[derive(Debug, Clone, serde::Serialize)]
pub(crate) struct Latency {
    /// The scheduling that the kernel granted to the thread.
    pub granted: String,
    /// The CPU it was pinned to.
    pub cpu: usize,
    /// Number of wake-ups.
    pub samples: usize,
    /// The shortest, in microseconds.
    pub min: f64,
    /// Half of them are no later than this.
    pub median: f64,
    /// 99 % of them are no later than this.
    pub p99: f64,
    /// The longest.
    pub max: f64,
    /// The longest that is no stall of the machine.
    pub max_undisturbed: f64,
    /// The histogram.
    pub histogram: Vec<Class>,
}

/// One class of the histogram.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Class {
    /// The smallest latency of the class, in microseconds.
    pub from_us: i64,
    /// The end of the class, not included; absent for the last class.
    pub below_us: Option<i64>,
    /// Wake-ups in it.
    pub count: usize,
}

/// Measures for `duration` on `cpu` with `policy`.
pub(crate) fn measure(cpu: usize, policy: Policy, duration: Nanos) -> Result<Latency, Failure> {
    let refused = |e: &dyn std::fmt::Display| Failure::refused(format!("latency thread: {e}"));
    let spec = ThreadSpec::new("latency").policy(policy).cpu(cpu);
    let thread = spawn(spec, move || {
        (sleep_again_and_again(duration), granted(current_tid()))
    })
    .map_err(|e| refused(&e))?;
    let (samples, granted) = thread.join().map_err(|_| refused(&"it panicked"))?;
    let granted = granted.map_err(|e| refused(&e))?.to_string();
    let undisturbed = samples.iter().copied().filter(|s| *s < STALL).max();
    let sorted = Sorted::new(samples);
    Ok(Latency {
        granted,
        cpu,
        samples: sorted.len(),
        min: us(sorted.min()),
        median: us(sorted.median()),
        p99: us(sorted.percentile(99)),
        max: us(sorted.max()),
        max_undisturbed: us(undisturbed.unwrap_or_else(|| sorted.median())),
        histogram: histogram(&sorted),
    })
}

fn sleep_again_and_again(duration: Nanos) -> Vec<i64> {
    let mut samples = Vec::with_capacity(usize::try_from(duration / INTERVAL).unwrap_or(0) + 1);
    let end = clock::monotonic() + duration.min(60 * SEC);
    let mut next = clock::monotonic() + INTERVAL;
    while next < end {
        clock::sleep_until(next);
        let late = clock::monotonic().saturating_sub(next);
        samples.push(i64::try_from(late).unwrap_or(i64::MAX));
        // After a stall the missed wake-ups are left out: they would all tell of the same stall.
        next += INTERVAL * (late / INTERVAL + 1);
    }
    samples
}

fn histogram(sorted: &Sorted) -> Vec<Class> {
    let mut from_us = 0;
    CLASSES
        .iter()
        .map(|&below| {
            let count = sorted.count(from_us * 1_000, below.saturating_mul(1_000));
            let open = below == CLASSES[CLASSES.len() - 1];
            let class = Class {
                from_us,
                below_us: (!open).then_some(below),
                count,
            };
            from_us = below;
            class
        })
        .collect()
}

impl Latency {
    /// The histogram for the terminal: one line per class that has samples.
    pub(crate) fn to_text(&self) -> String {
        const WIDTH: usize = 40;
        let most = self
            .histogram
            .iter()
            .map(|c| c.count)
            .max()
            .unwrap_or(0)
            .max(1);
        let mut text = String::new();
        for class in self.histogram.iter().filter(|c| c.count > 0) {
            let range = match class.below_us {
                Some(below) => format!("{}..{below}", class.from_us),
                None => format!("{} and more", class.from_us),
            };
            let bar = "#".repeat((class.count * WIDTH).div_ceil(most));
            text.push_str(&format!("    {range:>13} us {:>6}  {bar}\n", class.count));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_is_in_one_class() {
        let samples: Vec<i64> = vec![0, 4_999, 5_000, 29_000, 700_000, 90_000_000];
        let classes = histogram(&Sorted::new(samples));
        assert_eq!(classes.iter().map(|c| c.count).sum::<usize>(), 6);
        assert_eq!(classes[0].count, 2);
        assert_eq!(
            classes[CLASSES.len() - 1],
            Class {
                from_us: 5_000,
                below_us: None,
                count: 1
            }
        );
    }
}
