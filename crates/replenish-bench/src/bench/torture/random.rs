//! Random numbers by seed: the same on every machine and in every version.

/// `SplitMix64` (Steele, Lea, Flood 2014).
#[derive(Debug, Clone)]
pub(super) struct Random(u64);

impl Random {
    /// The sequence of a seed.
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Any number.
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number of `low..=high`.
    pub(super) fn within(&mut self, low: u64, high: u64) -> u64 {
        low + self.next() % (high.saturating_sub(low) + 1)
    }

    /// A number in 0..1.
    pub(super) fn fraction(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// `true` in so many of a hundred cases.
    pub(super) fn percent(&mut self, chance: u64) -> bool {
        self.within(0, 99) < chance
    }

    /// One of them.
    pub(super) fn one_of<T: Copy>(&mut self, of: &[T], otherwise: T) -> T {
        let last = of.len().saturating_sub(1) as u64;
        let at = usize::try_from(self.within(0, last)).unwrap_or(0);
        of.get(at).copied().unwrap_or(otherwise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_has_one_sequence() {
        let draw = |seed| {
            let mut r = Random::new(seed);
            (r.within(0, u64::MAX - 1), r.within(1, 6), r.fraction())
        };
        assert_eq!(draw(7), draw(7));
        assert_ne!(draw(7), draw(8));
    }

    #[test]
    fn ranges_are_kept() {
        let mut r = Random::new(1);
        for _ in 0..1000 {
            assert!((3..=5).contains(&r.within(3, 5)));
            assert!((0.0..1.0).contains(&r.fraction()));
        }
    }
}
