//! Releases of timers and rounds: absolute times on the monotonic clock, and the rule for overrun
//! ones. Pure.

use crate::Nanos;
use core::time::Duration;

/// The rule for releases that fall into a callback or a preemption.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Overrun {
    /// Only the latest is served, the others are counted as skipped. The phase is kept.
    #[default]
    Skip,
    /// All are served, one after another without pause. The phase is kept.
    CatchUp,
    /// The late one is served, and the next follows one period after that start. The phase moves.
    Delay,
}

/// Releases of a timer: a period, and possibly more.
///
/// ```
/// use replenish::{Every, Overrun};
/// use std::time::Duration;
/// let ms = Duration::from_millis;
/// let control = Every::period(ms(10)).first_after(ms(5)).overrun(Overrun::CatchUp);
/// let usual: Every = ms(10).into();
/// # let _ = (control, usual);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Every {
    pub(crate) period: Duration,
    pub(crate) first_after: Duration,
    pub(crate) overrun: Overrun,
    pub(crate) once: bool,
    pub(crate) autostart: bool,
}

impl Every {
    /// The first release one period after the start, overrun releases skipped.
    #[must_use]
    pub const fn period(period: Duration) -> Self {
        Self {
            period,
            first_after: period,
            overrun: Overrun::Skip,
            once: false,
            autostart: true,
        }
    }

    /// Releases the timer once, this long after the start; 0 for at once. A
    /// [`TimerHandle`](crate::TimerHandle) can start it again.
    #[must_use]
    pub const fn once(after: Duration) -> Self {
        Self {
            once: true,
            ..Self::period(after)
        }
    }

    /// Releases nothing until a [`TimerHandle`](crate::TimerHandle) starts the timer.
    #[must_use]
    pub const fn not_started(self) -> Self {
        Self {
            autostart: false,
            ..self
        }
    }

    /// The first release this long after the start: an offset, 0 for at once.
    #[must_use]
    pub const fn first_after(self, first_after: Duration) -> Self {
        Self {
            first_after,
            ..self
        }
    }

    /// The rule for overrun releases.
    #[must_use]
    pub const fn overrun(self, overrun: Overrun) -> Self {
        Self { overrun, ..self }
    }
}

impl From<Duration> for Every {
    fn from(period: Duration) -> Self {
        Self::period(period)
    }
}

/// The releases of one timer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Schedule {
    next: Nanos,
    period: Nanos,
    overrun: Overrun,
}

/// A release that is served now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Release {
    pub(crate) at: Nanos,
    pub(crate) skipped: u64,
}

impl Schedule {
    /// `period` in nanoseconds, at least 1.
    pub(crate) fn new(first: Nanos, period: Nanos, overrun: Overrun) -> Self {
        Self {
            next: first,
            period: period.max(1),
            overrun,
        }
    }

    /// The next release; `Nanos::MAX` if there is none.
    pub(crate) fn next(&self) -> Nanos {
        self.next
    }

    /// Stops all releases.
    pub(crate) fn cancel(&mut self) {
        self.next = Nanos::MAX;
    }

    pub(crate) fn is_cancelled(&self) -> bool {
        self.next == Nanos::MAX
    }

    pub(crate) fn period(&self) -> Nanos {
        self.period
    }

    /// The next release is one period after `now`.
    pub(crate) fn restart(&mut self, now: Nanos) {
        self.next = now.saturating_add(self.period);
    }

    /// Sets another period, which counts from the latest release (or from the start, before the
    /// first).
    pub(crate) fn change_period(&mut self, period: Nanos) {
        let period = period.max(1);
        if !self.is_cancelled() {
            self.next = self.next.saturating_sub(self.period).saturating_add(period);
        }
        self.period = period;
    }

    /// Takes the release to be served at `now`, if one is due.
    pub(crate) fn serve(&mut self, now: Nanos) -> Option<Release> {
        let behind = now
            .checked_sub(self.next)
            .filter(|_| !self.is_cancelled())?;
        let due = self.next;
        let release = match self.overrun {
            Overrun::Skip => {
                let skipped = behind / self.period;
                let at = due.saturating_add(skipped.saturating_mul(self.period));
                Release { at, skipped }
            }
            Overrun::CatchUp | Overrun::Delay => Release {
                at: due,
                skipped: 0,
            },
        };
        self.next = match self.overrun {
            Overrun::Delay if behind >= self.period => now.saturating_add(self.period),
            _ => release.at.saturating_add(self.period),
        };
        Some(release)
    }
}

/// Nanoseconds of a duration; 584 years at most. (One body for all of them.)
#[inline(never)]
pub(crate) fn nanos(d: Duration) -> Nanos {
    const SECOND: Nanos = 1_000_000_000;
    match d.as_secs() {
        seconds if seconds <= Nanos::MAX / SECOND => {
            (seconds * SECOND).saturating_add(d.subsec_nanos().into())
        }
        _ => Nanos::MAX,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn served(overrun: Overrun, calls: &[Nanos]) -> Vec<Option<(Nanos, u64)>> {
        let mut s = Schedule::new(10, 10, overrun);
        calls
            .iter()
            .map(|t| s.serve(*t).map(|r| (r.at, r.skipped)))
            .collect()
    }

    #[test]
    fn on_time_all_rules_are_alike() {
        for rule in [Overrun::Skip, Overrun::CatchUp, Overrun::Delay] {
            let got = served(rule, &[9, 10, 11, 20, 33, 40]);
            let want = [
                None,
                Some((10, 0)),
                None,
                Some((20, 0)),
                Some((30, 0)),
                Some((40, 0)),
            ];
            assert_eq!(got, want, "{rule:?}");
        }
    }

    #[test]
    fn skip_serves_the_latest_and_keeps_the_phase() {
        let got = served(Overrun::Skip, &[10, 45, 46, 50]);
        assert_eq!(got, [Some((10, 0)), Some((40, 2)), None, Some((50, 0))]);
    }

    #[test]
    fn catch_up_serves_every_release() {
        let got = served(Overrun::CatchUp, &[10, 45, 45, 45, 45, 50]);
        let want = [
            Some((10, 0)),
            Some((20, 0)),
            Some((30, 0)),
            Some((40, 0)),
            None,
            Some((50, 0)),
        ];
        assert_eq!(got, want);
    }

    #[test]
    fn delay_moves_the_phase_to_the_late_start() {
        let got = served(Overrun::Delay, &[10, 45, 54, 55, 65]);
        let want = [
            Some((10, 0)),
            Some((20, 0)),
            None,
            Some((55, 0)),
            Some((65, 0)),
        ];
        assert_eq!(got, want);
    }

    /// A release that begins when the next one is due has lost its phase; a moment earlier it has
    /// not.
    #[test]
    fn delay_keeps_the_phase_of_a_release_less_than_a_period_late() {
        let got = served(Overrun::Delay, &[19, 20, 30]);
        assert_eq!(got, [Some((10, 0)), Some((20, 0)), Some((30, 0))]);
        let got = served(Overrun::Delay, &[20, 29, 30]);
        assert_eq!(got, [Some((10, 0)), None, Some((30, 0))]);
    }

    #[test]
    fn releases_at_the_end_of_time_do_not_overflow() {
        let mut s = Schedule::new(Nanos::MAX - 1, Nanos::MAX, Overrun::Skip);
        assert!(s.serve(Nanos::MAX).is_some());
        assert_eq!(s.next(), Nanos::MAX);
    }

    #[test]
    fn a_new_period_counts_from_the_latest_release() {
        let mut s = Schedule::new(10, 10, Overrun::Skip);
        s.change_period(4); // before the first release: from the start
        assert_eq!(s.next(), 4);
        assert!(s.serve(5).is_some());
        s.change_period(100);
        assert_eq!(s.next(), 104);
        s.cancel();
        s.change_period(7);
        assert_eq!(s.serve(1_000_000), None);
        assert_eq!(s.serve(Nanos::MAX), None, "not at the end of time either");
        s.restart(50);
        assert_eq!(s.next(), 57);
    }
}
