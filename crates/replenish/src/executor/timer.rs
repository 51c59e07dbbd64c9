//! Timers: absolute releases on the monotonic clock, and what happens to those that are overrun.

use super::callback::{CallbackContext, CallbackResult};
use super::handle::{Env, Handle, Shared};
use crate::Nanos;
use crate::sync::Arc;
use core::time::Duration;
use replenish_os::clock;

/// What happens to releases that fall into a callback or a preemption.
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

/// When a timer fires: a period, and possibly more.
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
}

impl Every {
    /// The first release one period after the start, overrun releases skipped.
    #[must_use]
    pub const fn period(period: Duration) -> Self {
        Self {
            period,
            first_after: period,
            overrun: Overrun::Skip,
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

    /// What happens to overrun releases.
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

    pub(crate) fn next(&self) -> Nanos {
        self.next
    }

    /// Takes the release to be served at `now`, if one is due.
    pub(crate) fn serve(&mut self, now: Nanos) -> Option<Release> {
        let behind = now.checked_sub(self.next)?;
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

pub(crate) struct Timer<F> {
    shared: Arc<Shared>,
    every: Every,
    schedule: Schedule,
    callback: F,
}

impl<F> Timer<F> {
    pub(crate) fn new(shared: Arc<Shared>, every: Every, callback: F) -> Self {
        Self {
            shared,
            every,
            schedule: Schedule::new(Nanos::MAX, nanos(every.period), every.overrun),
            callback,
        }
    }
}

impl<F, R> Handle for Timer<F>
where
    F: FnMut(&CallbackContext<'_>) -> R + Send,
    R: CallbackResult,
{
    fn begin(&mut self, start: Nanos) {
        let first = start.saturating_add(nanos(self.every.first_after));
        self.schedule = Schedule::new(first, nanos(self.every.period), self.every.overrun);
    }

    fn is_ready(&self, now: Nanos) -> bool {
        self.schedule.next() <= now
    }

    fn next_release(&self) -> Option<Nanos> {
        Some(self.schedule.next())
    }

    fn run(&mut self, env: &Env<'_>) {
        let started = clock::monotonic();
        let Some(release) = self.schedule.serve(started) else {
            return;
        };
        let counters = &self.shared.counters;
        counters.skipped.add(release.skipped);
        let latency = started.saturating_sub(release.at);
        counters.worst_latency.raise(latency);
        let cx = CallbackContext {
            id: &self.shared.id,
            worker: env.worker,
            due: release.at,
            started,
            skipped: release.skipped,
            stop: env.stop,
        };
        let result = (self.callback)(&cx);
        result.inspect(&mut |e| self.shared.failed(e, env.events));
        counters.executed.add(1);
        let deadline = release.at.saturating_add(nanos(self.every.period));
        let lateness = clock::monotonic().saturating_sub(deadline);
        if lateness > 0 {
            counters.deadline_misses.add(1);
            counters.worst_lateness.raise(lateness);
        }
    }
}

/// Nanoseconds of a duration; 584 years at most.
pub(crate) fn nanos(d: Duration) -> Nanos {
    Nanos::try_from(d.as_nanos()).unwrap_or(Nanos::MAX)
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

    #[test]
    fn releases_at_the_end_of_time_do_not_overflow() {
        let mut s = Schedule::new(Nanos::MAX - 1, Nanos::MAX, Overrun::Skip);
        assert!(s.serve(Nanos::MAX).is_some());
        assert_eq!(s.next(), Nanos::MAX);
    }
}
