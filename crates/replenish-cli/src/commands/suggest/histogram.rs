//! Counts of execution times, in buckets of a quarter of an octave.

use crate::time::Nanos;
use replenish_recorder::{CHAIN_BUCKETS, bucket_end};

/// Execution times of one callback.
#[derive(Debug, Clone)]
pub(super) struct Histogram {
    counts: [u64; CHAIN_BUCKETS],
    pub(super) most: Nanos,
}

/// A bucket that is not empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Bucket {
    /// The longest time that belongs to it.
    pub(super) end: Nanos,
    pub(super) count: u64,
}

impl Default for Histogram {
    fn default() -> Self {
        Self {
            counts: [0; CHAIN_BUCKETS],
            most: 0,
        }
    }
}

impl Histogram {
    pub(super) fn add(&mut self, time: Nanos) {
        self.most = self.most.max(time);
        let at = (0..CHAIN_BUCKETS).find(|n| time <= bucket_end(*n));
        if let Some(count) = at.and_then(|at| self.counts.get_mut(at)) {
            *count += 1;
        }
    }

    /// The time that `percent` of all do not exceed: the end of its bucket, and no more than the
    /// longest time.
    pub(super) fn percentile(&self, percent: u64) -> Nanos {
        let rank = (self.count() * percent).div_ceil(100).max(1);
        let mut seen = 0;
        let reached = |bucket: &Bucket| {
            seen += bucket.count;
            seen >= rank
        };
        let bucket = self.buckets().find(reached);
        bucket.map_or(0, |bucket| bucket.end)
    }

    pub(super) fn count(&self) -> u64 {
        self.counts.iter().sum()
    }

    pub(super) fn buckets(&self) -> impl Iterator<Item = Bucket> + '_ {
        let all = self.counts.iter().enumerate();
        all.filter(|(_, count)| **count > 0)
            .map(|(n, count)| Bucket {
                end: bucket_end(n).min(self.most),
                count: *count,
            })
    }
}
