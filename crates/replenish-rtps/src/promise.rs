//! Promises over time: a sample in each period, a sign of life in each lease (DDS 1.4, 2.2.3.7 and
//! 2.2.3.11). State machines without a clock: their owner brings the time.
//!
//! ```text
//!   Deadline   (idle) ──first sample──► running ──period over──► missed, the next period runs
//!                ▲                        │  ▲───────sample────────┘
//!                └───── nobody to hear ───┘
//!
//!   Lease      (idle, alive) ──sign──► running, alive ──lease over──► lost
//!                                          ▲────────────sign────────────┘
//! ```

use crate::wire::{INFINITE, Nanos};

/// The longest time between two samples, and how often it was exceeded.
#[derive(Clone, Copy, Debug)]
pub struct Deadline {
    period: Nanos,
    next: Nanos,
    missed: u64,
}

impl Deadline {
    /// A deadline that begins with the first sample; none if `period` is 0 or [`INFINITE`].
    #[must_use]
    pub const fn new(period: Nanos) -> Self {
        Self {
            period: if period == 0 { INFINITE } else { period },
            next: INFINITE,
            missed: 0,
        }
    }

    /// A sample has come. Whether that was the first one: its owner has another time to wake at.
    pub const fn renew(&mut self, now: Nanos) -> bool {
        if self.period == INFINITE {
            return false;
        }
        let begins = self.next == INFINITE;
        self.next = now.saturating_add(self.period);
        begins
    }

    /// Samples are due no more: the deadline begins anew with the next one.
    pub const fn stop(&mut self) {
        self.next = INFINITE;
    }

    /// Counts the periods that are over by now.
    pub const fn check(&mut self, now: Nanos) {
        if self.next == INFINITE || now < self.next {
            return;
        }
        let periods = (now - self.next) / self.period + 1;
        self.missed = self.missed.saturating_add(periods);
        let past = periods.saturating_mul(self.period);
        self.next = self.next.saturating_add(past);
    }

    /// Time to [check](Self::check) it; [`INFINITE`]: never.
    #[must_use]
    pub const fn next(&self) -> Nanos {
        self.next
    }

    /// Periods without a sample so far.
    #[must_use]
    pub const fn missed(&self) -> u64 {
        self.missed
    }
}

/// The time that a writer counts as alive after a sign of life, and the number of times that it was
/// silent for longer.
#[derive(Clone, Copy, Debug)]
pub struct Lease {
    time: Nanos,
    ends: Nanos,
    alive: bool,
    lost: u64,
}

impl Lease {
    /// A lease that is alive and begins with the first sign. It never ends if `time` is 0 or
    /// [`INFINITE`].
    #[must_use]
    pub const fn new(time: Nanos) -> Self {
        Self {
            time: if time == 0 { INFINITE } else { time },
            ends: INFINITE,
            alive: true,
            lost: 0,
        }
    }

    /// A sign of life. Whether it begins anew: its owner has another time to wake at.
    pub const fn renew(&mut self, now: Nanos) -> bool {
        if self.time == INFINITE {
            return false;
        }
        let begins = self.ends == INFINITE;
        self.alive = true;
        self.ends = now.saturating_add(self.time);
        begins
    }

    /// Ends it if its time is over.
    pub const fn check(&mut self, now: Nanos) {
        if self.ends != INFINITE && self.ends <= now {
            self.ends = INFINITE;
            self.alive = false;
            self.lost = self.lost.saturating_add(1);
        }
    }

    /// Time to [check](Self::check) it; [`INFINITE`]: never.
    #[must_use]
    pub const fn next(&self) -> Nanos {
        self.ends
    }

    /// Whether it has not ended, or began anew.
    #[must_use]
    pub const fn is_alive(&self) -> bool {
        self.alive
    }

    /// Whether it can end.
    #[must_use]
    pub const fn is_finite(&self) -> bool {
        self.time != INFINITE
    }

    /// Number of times that the lease has ended.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deadline_counts_every_period_without_a_sample() {
        let mut deadline = Deadline::new(10);
        deadline.check(1000);
        assert_eq!((deadline.next(), deadline.missed()), (INFINITE, 0));
        assert!(deadline.renew(100));
        assert!(!deadline.renew(105));
        deadline.check(114);
        assert_eq!((deadline.next(), deadline.missed()), (115, 0));
        deadline.check(115);
        assert_eq!((deadline.next(), deadline.missed()), (125, 1));
        // Looked at late, it counts the same.
        deadline.check(146);
        assert_eq!((deadline.next(), deadline.missed()), (155, 4));
        deadline.stop();
        deadline.check(10_000);
        assert_eq!(deadline.missed(), 4);
        assert!(deadline.renew(10_000));
    }

    #[test]
    fn a_lease_ends_once_until_the_next_sign() {
        let mut lease = Lease::new(10);
        lease.check(1000);
        assert!(lease.is_alive());
        assert!(lease.renew(1000));
        lease.check(1009);
        assert!(lease.is_alive());
        lease.check(1010);
        lease.check(2000);
        assert_eq!((lease.is_alive(), lease.lost()), (false, 1));
        assert!(lease.renew(2000));
        assert!(lease.is_alive());
        assert!(!lease.renew(2005));
        lease.check(2014);
        assert_eq!((lease.lost(), lease.next()), (1, 2015));
    }

    #[test]
    fn zero_and_infinite_are_no_promise() {
        for time in [0, INFINITE] {
            let (mut deadline, mut lease) = (Deadline::new(time), Lease::new(time));
            assert!(!deadline.renew(5) && !lease.renew(5) && !lease.is_finite());
            assert_eq!((deadline.next(), lease.next()), (INFINITE, INFINITE));
        }
    }
}
