//! The result of a run, as people and programs read it.

use super::case::Case;
use super::judge::Finding;
use serde::{Deserialize, Serialize};

/// Number of distances that are kept.
const WORST: usize = 10;

/// The result. The first four names are a contract.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Totals {
    /// Seeds that were run.
    pub seeds: u64,
    /// Seconds that each case ran.
    pub seconds: u64,
    /// Promises that were broken.
    pub violations: u64,
    /// The ten that came nearest to their bounds, or went furthest beyond.
    pub worst: Vec<Distance>,
    /// The seeds, in the order in which they ran.
    pub ran: Vec<u64>,
    /// Runs that were repeated: the machine stood still for much of them, or stood still and
    /// they broke.
    pub repeated: u64,
    /// Seeds that count although the machine stood still for more than 10 ms, or had 40 ms stolen.
    #[serde(default)]
    pub disturbed: Vec<u64>,
    /// Seeds whose repeats stood still, too: not judged.
    pub unjudged: Vec<u64>,
    /// Broken promises with the smallest case that shows them.
    pub failures: Vec<Failed>,
    /// Guarantees that the executor itself said it could not give, by seed.
    pub fallbacks: Vec<(u64, String)>,
}

/// One promise: the bound and what was measured.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Distance {
    pub seed: u64,
    /// The case in words.
    pub case: String,
    pub bound_us: f64,
    pub measured_us: f64,
    pub promise: String,
    pub worker: String,
}

/// A broken promise.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Failed {
    pub seed: u64,
    pub text: String,
    pub smallest: Option<Case>,
}

impl Distance {
    pub(super) fn of(case: &Case, finding: &Finding) -> Self {
        Self {
            seed: case.seed,
            case: case.to_string(),
            bound_us: finding.bound as f64 / 1e3,
            measured_us: finding.measured as f64 / 1e3,
            promise: finding.promise.to_string(),
            worker: match case.workers.get(finding.worker) {
                Some(w) => format!(
                    "w{}: {:?} us every {:?} us at {}, {:?}",
                    finding.worker,
                    w.budget as f64 / 1e3,
                    w.period as f64 / 1e3,
                    w.priority,
                    w.work
                ),
                None => String::new(),
            },
        }
    }

    fn beyond(&self) -> f64 {
        self.measured_us - self.bound_us
    }
}

impl Totals {
    /// Takes in what one seed showed.
    pub(super) fn add(&mut self, distances: impl IntoIterator<Item = Distance>) {
        self.worst.extend(distances);
        self.worst.sort_by(|a, b| b.beyond().total_cmp(&a.beyond()));
        self.worst.truncate(WORST);
    }

    /// Takes in an earlier run of other seeds.
    pub(super) fn merge(&mut self, other: Self) {
        self.seeds += other.seeds;
        self.violations += other.violations;
        self.repeated += other.repeated;
        self.ran.splice(0..0, other.ran);
        self.disturbed.splice(0..0, other.disturbed);
        self.unjudged.splice(0..0, other.unjudged);
        self.failures.splice(0..0, other.failures);
        self.fallbacks.splice(0..0, other.fallbacks);
        self.add(other.worst);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn distance(seed: u64, measured_us: f64) -> Distance {
        Distance {
            seed,
            case: String::new(),
            bound_us: 100.0,
            measured_us,
            promise: String::new(),
            worker: String::new(),
        }
    }

    #[test]
    fn the_ten_worst_are_kept_across_runs() {
        let mut first = Totals {
            seeds: 20,
            ..Totals::default()
        };
        first.add((0..20).map(|n| distance(n, n as f64)));
        let mut second = Totals {
            seeds: 1,
            violations: 1,
            ..Totals::default()
        };
        second.add([distance(99, 105.0)]);
        second.merge(first);
        assert_eq!((second.seeds, second.violations), (21, 1));
        let seeds: Vec<u64> = second.worst.iter().map(|d| d.seed).collect();
        assert_eq!(seeds, [99, 19, 18, 17, 16, 15, 14, 13, 12, 11]);
    }
}
