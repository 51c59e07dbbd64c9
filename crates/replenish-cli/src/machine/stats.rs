//! Order statistics of samples.

/// A sorted set of samples.
#[derive(Debug, Clone, Default)]
pub struct Sorted(Vec<i64>);

impl Sorted {
    /// Sorts `samples`.
    pub fn new(mut samples: Vec<i64>) -> Self {
        samples.sort_unstable();
        Self(samples)
    }

    /// The smallest sample that at least `percent` of all samples do not exceed; 0 if there are
    /// none.
    pub fn percentile(&self, percent: usize) -> i64 {
        let rank = (self.0.len() * percent.min(100)).div_ceil(100).max(1);
        self.0.get(rank - 1).copied().unwrap_or(0)
    }

    /// Half of the samples do not exceed it.
    pub fn median(&self) -> i64 {
        self.percentile(50)
    }

    /// The number of samples.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The largest sample; 0 if there are none.
    pub fn max(&self) -> i64 {
        self.0.last().copied().unwrap_or(0)
    }

    /// The smallest sample; 0 if there are none.
    pub fn min(&self) -> i64 {
        self.0.first().copied().unwrap_or(0)
    }

    /// Number of samples in `from..to`.
    pub fn count(&self, from: i64, to: i64) -> usize {
        self.0.partition_point(|x| *x < to) - self.0.partition_point(|x| *x < from)
    }
}

/// Nanoseconds in microseconds, to three decimals.
pub fn us(ns: i64) -> f64 {
    ns as f64 / 1e3
}

#[cfg(test)]
mod tests {
    use super::Sorted;

    #[test]
    fn percentiles_are_samples() {
        let s = Sorted::new((1..=100).rev().collect());
        assert_eq!(
            (s.min(), s.median(), s.percentile(99), s.max()),
            (1, 50, 99, 100)
        );
        assert_eq!(Sorted::new(vec![7]).percentile(99), 7);
        assert_eq!(Sorted::default().median(), 0);
        assert_eq!(s.count(10, 20), 10);
        assert_eq!(s.count(200, 300), 0);
    }
}
