//! From samples of one thread to its period, and to the most CPU time in any such period.
//!
//! A thread that waits gives the CPU back of its own accord; the kernel counts how often. A worker
//! with one timer does so once a period. So the mean time between two waits is taken as the
//! period, cut to the next shorter one of [`PERIODS`]. A shorter period than the true one costs
//! some enforcement and breaks no deadline.

use crate::time::{MS, Nanos};
use std::collections::VecDeque;

/// The periods that are suggested, in milliseconds: 200 to 2 Hz as robots have them.
pub(super) const PERIODS: [u64; 13] = [5, 10, 16, 20, 25, 33, 40, 50, 66, 100, 200, 250, 500];
/// The period of a thread that did not show one, in milliseconds.
pub(super) const UNKNOWN: u64 = 100;
/// Fewer waits than this show no rhythm.
const FEW: u64 = 5;

/// A reading of a thread's counters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sample {
    /// When, in ns.
    pub(super) time: Nanos,
    /// CPU time so far, in ns.
    pub(super) cpu: Nanos,
    /// Times that it has given the CPU back by itself.
    pub(super) waits: u64,
}

/// The most CPU time in any window of one length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Window {
    /// Its length in ns.
    pub(super) length: Nanos,
    /// The most that was taken in one, in ns.
    pub(super) most: Nanos,
    /// Windows looked at: each sample ends one.
    pub(super) count: u64,
}

/// The samples of one thread: as many as the longest window needs.
#[derive(Debug, Clone)]
pub(super) struct Rhythm {
    recent: VecDeque<(Nanos, Nanos)>,
    windows: Vec<Window>,
    first: Sample,
    last: Sample,
}

impl Rhythm {
    /// Looks at windows of the period that was `asked` for, or of all [`PERIODS`].
    pub(super) fn new(asked: Option<Nanos>, first: Sample) -> Self {
        let window = |length| Window {
            length,
            most: 0,
            count: 0,
        };
        let windows = match asked {
            Some(length) => vec![window(length)],
            None => PERIODS.map(|period| window(period * MS)).to_vec(),
        };
        Self {
            recent: VecDeque::new(),
            windows,
            first,
            last: first,
        }
    }

    /// Takes the next sample.
    pub(super) fn sample(&mut self, sample: Sample) {
        let Sample { time, cpu, .. } = sample;
        self.last = sample;
        self.recent.push_back((time, cpu));
        let longest = self.windows.iter().map(|w| w.length).max().unwrap_or(0);
        // The oldest sample that is a whole window ago stays.
        while self.recent.get(1).is_some_and(|(t, _)| time - t >= longest) {
            self.recent.pop_front();
        }
        for window in &mut self.windows {
            let later = |(t, _): &(Nanos, Nanos)| time - t >= window.length;
            let before = self.recent.partition_point(later).checked_sub(1);
            let Some(&(from, was)) = before.and_then(|at| self.recent.get(at)) else {
                continue;
            };
            // A late sample makes the window longer; what is more is taken as evenly spread.
            let used = u128::from(cpu.saturating_sub(was)) * u128::from(window.length);
            let used = used / u128::from((time - from).max(1));
            window.most = window.most.max(Nanos::try_from(used).unwrap_or(Nanos::MAX));
            window.count += 1;
        }
    }

    /// The mean time between two waits, if it has waited often enough.
    pub(super) fn interval(&self) -> Option<Nanos> {
        let waits = self.last.waits.saturating_sub(self.first.waits);
        (waits >= FEW).then(|| self.last.time.saturating_sub(self.first.time) / waits)
    }

    /// The window of its period: the one asked for, the one it has shown, or [`UNKNOWN`]. `None`
    /// if it was not looked at for a whole one.
    pub(super) fn window(&self) -> Option<Window> {
        // The timers of a busy machine are late now and then: 5 % longer is still that period.
        let fits = |w: &&Window| self.interval().is_none_or(|i| w.length <= i + i / 20);
        let unknown = UNKNOWN * MS;
        let shown = match self.interval() {
            Some(_) => self.windows.iter().rev().find(fits),
            None => self.windows.iter().find(|w| w.length == unknown),
        };
        let window = shown.or(self.windows.first())?;
        (window.count > 0).then_some(*window)
    }

    /// The share of one CPU it took all in all, in percent.
    pub(super) fn percent(&self) -> f64 {
        let used = self.last.cpu.saturating_sub(self.first.cpu) as f64;
        used * 100.0 / self.last.time.saturating_sub(self.first.time).max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time: Nanos, cpu: Nanos, waits: u64) -> Sample {
        Sample { time, cpu, waits }
    }

    #[test]
    fn the_most_of_any_window_is_found_wherever_it_begins() {
        let mut seen = Rhythm::new(Some(100 * MS), at(0, 0, 0));
        let mut cpu = 0;
        for step in 0..=100 {
            // 1 ms in every 10, but 5 in each of the four steps from 33 on.
            cpu += if (33..37).contains(&step) { 5 } else { 1 } * MS;
            seen.sample(at(step * 10 * MS, cpu, 0));
        }
        let window = seen.window().unwrap();
        assert_eq!(window.most, (4 * 5 + 6) * MS);
        assert_eq!(window.count, 91);
        assert!(seen.recent.len() <= 12);
    }

    #[test]
    fn the_period_is_that_of_its_waits() {
        let watched = |every: Nanos, seconds: u64| {
            let mut seen = Rhythm::new(None, at(0, 0, 7));
            for step in 0..seconds * 500 {
                let now = step * 2 * MS;
                seen.sample(at(now, now / 10, 7 + now / every));
            }
            seen.window().map(|w| w.length / MS)
        };
        for (every, period) in [
            (10, 10),
            (21, 20),
            (34, 33),
            (100, 100),
            (170, 100),
            (900, 500),
        ] {
            assert_eq!(watched(every * MS, 10), Some(period), "{every} ms");
        }
        assert_eq!(watched(2 * MS, 10), Some(5));
        // Two waits in a second show nothing.
        assert_eq!(watched(400 * MS, 1), Some(UNKNOWN));
        assert_eq!(watched(400 * MS, 0), None);
    }

    #[test]
    fn a_period_that_is_asked_for_holds() {
        let mut seen = Rhythm::new(Some(70 * MS), at(0, 0, 0));
        (0..100).for_each(|step| seen.sample(at(step * 10 * MS, 0, step)));
        assert_eq!(seen.window().unwrap().length, 70 * MS);
    }
}
