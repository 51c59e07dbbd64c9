//! Random numbers that are the same on every machine, and spans of time drawn from them.

use crate::Nanos;

/// `SplitMix64` (Steele, Lea, Flood, OOPSLA 2014): small, fast, and reproducible by its seed. Not
/// for anything secret.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Random(u64);

impl Random {
    /// The stream that belongs to `seed`.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Stream number `index` of `seed`, so that one more draw by one thread does not change what
    /// the others draw.
    pub fn stream(seed: u64, index: usize) -> Self {
        let mut mixer = Self(seed ^ (index as u64).wrapping_mul(0xD1B5_4A32_D192_ED03));
        Self(mixer.next_u64())
    }

    /// The next 64 bits.
    pub const fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number in `0..=max`, each equally likely up to a bias of less than 2^-32 for every `max`
    /// below 2^32.
    pub fn up_to(&mut self, max: u64) -> u64 {
        let wide = u128::from(self.next_u64()) * (u128::from(max) + 1);
        (wide >> 64) as u64
    }

    /// A number in `low..=high`; `low` if the range is empty.
    pub fn between(&mut self, low: u64, high: u64) -> u64 {
        low.saturating_add(self.up_to(high.saturating_sub(low)))
            .min(high.max(low))
    }
}

/// A span of time that is drawn anew each time it is needed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Span {
    /// Always the same, in ns.
    Constant(Nanos),
    /// Each value from `min` to `max` equally likely; `min` if `max` is smaller.
    Uniform {
        /// The smallest value, in ns.
        min: Nanos,
        /// The largest value, in ns.
        max: Nanos,
    },
    /// Mostly `usual`, but `worst` in one of `one_in` draws: a rare slow path.
    Rare {
        /// The usual duration, in ns.
        usual: Nanos,
        /// The rare duration, in ns.
        worst: Nanos,
        /// One in this many; 0 means never.
        one_in: u32,
    },
    /// One of these measured values, each equally likely; 0 if there is none.
    Samples(Vec<Nanos>),
}

impl Span {
    /// Draws one value, in ns.
    pub fn draw(&self, random: &mut Random) -> Nanos {
        match self {
            Self::Constant(value) => *value,
            Self::Uniform { min, max } => random.between(*min, *max),
            Self::Rare {
                usual,
                worst,
                one_in,
            } => {
                let hit = *one_in > 0 && random.up_to(u64::from(*one_in) - 1) == 0;
                if hit { *worst } else { *usual }
            }
            Self::Samples(values) => {
                let last = values.len().saturating_sub(1) as u64;
                // The index is at most `last`, which came from a usize.
                let at = random.up_to(last) as usize;
                values.get(at).copied().unwrap_or(0)
            }
        }
    }

    /// The smallest value that can be drawn, in ns.
    pub fn min(&self) -> Nanos {
        match self {
            Self::Constant(value) => *value,
            Self::Uniform { min, .. } => *min,
            Self::Rare { usual, worst, .. } => *usual.min(worst),
            Self::Samples(values) => values.iter().copied().min().unwrap_or(0),
        }
    }

    /// The average of what is drawn, in ns.
    #[must_use]
    pub fn mean(&self) -> Nanos {
        let of = |sum: u128, count: u128| Nanos::try_from(sum / count.max(1)).unwrap_or(Nanos::MAX);
        let sum = |values: &[Nanos]| values.iter().map(|value| u128::from(*value)).sum();
        match self {
            Self::Constant(value) => *value,
            Self::Uniform { min, max } => of(sum(&[*min, *max.max(min)]), 2),
            Self::Rare {
                usual, one_in: 0, ..
            } => *usual,
            Self::Rare {
                usual,
                worst,
                one_in,
            } => {
                let often = u128::from(*one_in) - 1;
                of(u128::from(*usual) * often + u128::from(*worst), often + 1)
            }
            Self::Samples(values) => of(sum(values), values.len() as u128),
        }
    }

    /// The largest value that can be drawn, in ns.
    pub fn max(&self) -> Nanos {
        match self {
            Self::Constant(value) => *value,
            Self::Uniform { min, max } => *max.max(min),
            Self::Rare { usual, worst, .. } => *usual.max(worst),
            Self::Samples(values) => values.iter().copied().max().unwrap_or(0),
        }
    }
}

impl From<Nanos> for Span {
    fn from(value: Nanos) -> Self {
        Self::Constant(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_stay_in_range_and_reach_both_ends() {
        let mut random = Random::new(7);
        let span = Span::Uniform { min: 3, max: 6 };
        let seen: Vec<_> = (0..200).map(|_| span.draw(&mut random)).collect();
        assert_eq!(seen.iter().min(), Some(&3));
        assert_eq!(seen.iter().max(), Some(&6));
        assert_eq!(random.between(u64::MAX, 0), u64::MAX);
        assert!((0..50).any(|_| random.up_to(u64::MAX) > u64::MAX / 2));
    }

    #[test]
    fn streams_differ_and_repeat() {
        let draw = |index| Random::stream(1, index).next_u64();
        assert_ne!(draw(0), draw(1));
        assert_eq!(draw(1), draw(1));
    }

    #[test]
    fn samples_and_rare_draw_what_they_hold() {
        let mut random = Random::new(1);
        assert_eq!(Span::Samples(vec![]).draw(&mut random), 0);
        assert_eq!(Span::Samples(vec![5]).draw(&mut random), 5);
        let rare = Span::Rare {
            usual: 1,
            worst: 9,
            one_in: 4,
        };
        let slow = (0..4000).filter(|_| rare.draw(&mut random) == 9).count();
        assert!((800..1200).contains(&slow), "{slow}");
        assert_eq!(rare.max(), 9);
    }
}
