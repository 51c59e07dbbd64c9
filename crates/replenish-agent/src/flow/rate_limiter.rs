//! A limit per second, with bursts of up to one second's worth.

use replenish_xrce::Nanos;

const SECOND: Nanos = 1_000_000_000;

/// A token bucket in its time form: instead of tokens it keeps the time at which it would be full
/// again (the generic cell rate algorithm of ITU-T I.371). An amount above a second's worth goes
/// when the bucket is full, and the next one waits accordingly longer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RateLimiter {
    /// Units per second; at least 1.
    rate: u64,
    full_at: Nanos,
}

impl RateLimiter {
    /// `rate` units per second, or `None` for 0, which means no limit.
    pub(crate) fn new(rate: u32) -> Option<Self> {
        (rate > 0).then_some(Self {
            rate: rate.into(),
            full_at: 0,
        })
    }

    /// The earliest time at which `units` may go.
    pub(crate) fn earliest(&self, units: usize) -> Nanos {
        let cost = self.cost(units).min(SECOND);
        self.full_at.saturating_add(cost).saturating_sub(SECOND)
    }

    /// Whether all of a second's worth may go.
    pub(crate) fn is_full(&self, now: Nanos) -> bool {
        self.full_at <= now
    }

    /// Counts `units` as gone.
    pub(crate) fn spend(&mut self, now: Nanos, units: usize) {
        self.full_at = self.full_at.max(now).saturating_add(self.cost(units));
    }

    /// Counts `units` as gone if they may go at `now`.
    pub(crate) fn admit(&mut self, now: Nanos, units: usize) -> bool {
        let admitted = self.earliest(units) <= now;
        if admitted {
            self.spend(now, units);
        }
        admitted
    }

    fn cost(&self, units: usize) -> Nanos {
        (units as u64).saturating_mul(SECOND) / self.rate
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_s_worth_at_once_and_then_the_rate() {
        let mut limiter = RateLimiter::new(10).unwrap();
        let start = 5 * SECOND;
        assert_eq!((0..20).filter(|_| limiter.admit(start, 1)).count(), 10);
        assert_eq!(limiter.earliest(1), start + SECOND / 10);
        let later = (1..=100).filter(|i| limiter.admit(start + i * SECOND / 20, 1));
        assert_eq!(later.count(), 50);
        assert!(RateLimiter::new(0).is_none());
    }

    #[test]
    fn what_is_larger_than_a_second_s_worth_goes_and_is_paid_for() {
        let mut limiter = RateLimiter::new(100).unwrap();
        assert!(limiter.admit(SECOND, 1000));
        assert_eq!(limiter.earliest(1), 10 * SECOND + SECOND / 100);
        let mut slow = RateLimiter::new(1).unwrap();
        slow.spend(u64::MAX - 1, usize::MAX);
        assert_eq!(slow.earliest(1), u64::MAX - SECOND);
    }
}
