//! A worker's CPU time, split among its handles: time used since the last callback ended belongs to
//! the callback that just ended, the way there included.
//!
//! With a budget the account is asked after every callback. Without one it is the thread's CPU
//! clock, a system call that may cost more than the callback. Brief ones are therefore read
//! together:
//!
//! ```text
//!   brief callback ──► charged its duration and its part of the way, as it was in the last reading
//!   every 16th, or one that is not brief ──► clock read: charged what is left since the last reading
//! ```
//!
//! So all that was charged is what the clock said at the last reading: what was charged too much or
//! too little is made up for in the next parts.

use crate::Nanos;
use crate::platform::{STD, recorder};
use crate::stats::Counters;
use core::cell::Cell;
use replenish_os::{Meter, Usage};
use sporadic::{later, since};

/// Callbacks shorter than this are brief, in ns: reading the clock would be a twentieth of it.
const BRIEF: Nanos = 20_000;
/// Callbacks that are read together at most.
const TOGETHER: u64 = 16;

/// The charges of one worker's callbacks; lives on its thread.
pub(crate) struct CpuAccounting {
    pub(crate) meter: Meter,
    before: Cell<Usage>,
    budgeted: bool,
    split: Cell<Split>,
}

impl CpuAccounting {
    pub(crate) fn new(meter: Meter) -> Self {
        Self {
            before: Cell::new(meter.usage()),
            budgeted: meter.enforcement().is_some(),
            split: Cell::default(),
            meter,
        }
    }

    /// A callback has ended, `took` after its start: the CPU time that it took.
    #[inline]
    pub(crate) fn settle(&self, counters: &Counters, took: Nanos) -> Nanos {
        // A small kernel's clock costs no system call, and no room for the arithmetic.
        if self.budgeted || !STD {
            return self.settle_budget(counters);
        }
        let mut split = self.split.get();
        let charge = split.brief(took).unwrap_or_else(|| {
            let now = self.meter.usage();
            let before = self.before.replace(now);
            recorder::used(&now);
            split.read(since(now.cpu_high, before.cpu_high), took)
        });
        counters.cpu_high.add(charge);
        let used = split.execution(charge, took);
        counters.worst_execution.raise(used);
        self.split.set(split);
        used
    }

    fn settle_budget(&self, counters: &Counters) -> Nanos {
        let now = self.meter.usage();
        let before = self.before.replace(now);
        let high = since(now.cpu_high, before.cpu_high);
        let low = since(now.cpu_low, before.cpu_low);
        counters.cpu_high.add(high);
        counters.cpu_background.add(low);
        let used = later(high, low);
        counters.worst_execution.raise(used);
        let exhaustions = since(now.exhaustions, before.exhaustions);
        counters.exhaustions.add(exhaustions);
        used
    }
}

/// The arithmetic of brief callbacks.
#[derive(Debug, Clone, Copy, Default)]
struct Split {
    /// Callbacks since the last reading, what they were charged, and how long they took.
    unread: u64,
    charged: Nanos,
    durations: Nanos,
    /// The charge of each callback besides its duration; unknown before the first reading.
    way: Option<Nanos>,
    /// Time charged and not used at the last reading, as a negative number.
    error: i64,
    /// The part of it to take back from the next charges.
    back: Nanos,
}

impl Split {
    /// A brief callback: what it is charged. `None`: the clock is to be read.
    fn brief(&mut self, took: Nanos) -> Option<Nanos> {
        let way = self.way?;
        if took >= BRIEF || self.unread + 1 >= TOGETHER {
            return None;
        }
        // An earlier excess charge is not charged again.
        let whole = took + way;
        let charge = whole.saturating_sub(self.back);
        self.back -= whole - charge;
        self.unread += 1;
        self.durations += took;
        self.charged += charge;
        Some(charge)
    }

    /// The charge for a callback of `took` ns after which the clock was read.
    fn read(&mut self, used: Nanos, took: Nanos) -> Nanos {
        let owed = signed(used) - signed(self.charged) + self.error;
        let charge = u64::try_from(owed).unwrap_or(0);
        self.error = owed - signed(charge);
        self.back = self.error.unsigned_abs();
        if took < BRIEF {
            let callbacks = self.unread + 1;
            self.way = Some(used.saturating_sub(self.durations + took) / callbacks);
        }
        (self.unread, self.charged, self.durations) = (0, 0, 0);
        charge
    }

    /// CPU time of one callback, of which `charge` may make up for others.
    fn execution(&self, charge: Nanos, took: Nanos) -> Nanos {
        match self.way {
            Some(way) if took < BRIEF => took + way,
            _ => charge,
        }
    }
}

fn signed(time: Nanos) -> i64 {
    i64::try_from(time).unwrap_or(i64::MAX)
}

#[cfg(test)]
#[cfg(not(loom))]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn equal_callbacks_are_charged_equally_and_read_once_in_sixteen() {
        let mut split = Split::default();
        assert_eq!(split.brief(1000), None, "the first one is read");
        assert_eq!(split.read(6000, 1000), 6000);
        for _ in 0..3 {
            for _ in 1..TOGETHER {
                assert_eq!(split.brief(1000), Some(6000));
            }
            assert_eq!(split.brief(1000), None);
            assert_eq!(split.read(TOGETHER * 6000, 1000), 6000);
            assert_eq!(split.execution(6000, 1000), 6000);
        }
        assert_eq!(split.brief(BRIEF), None);
        assert_eq!(split.read(30_000, BRIEF), 30_000);
    }

    proptest! {
        /// The charged time is the used time plus a known excess, at every reading.
        ///
        /// The callbacks take any time. The excess is one batch's worth at most.
        #[test]
        fn what_is_charged_is_what_is_used(
            callbacks in proptest::collection::vec((0..2 * BRIEF, 0..2 * BRIEF), 1..300),
        ) {
            let (mut split, mut used, mut charged, mut since) = (Split::default(), 0, 0, 0);
            for (took, cpu) in callbacks {
                since += cpu;
                let brief = split.brief(took);
                charged += brief.unwrap_or_else(|| {
                    used += since;
                    split.read(core::mem::take(&mut since), took)
                });
                if brief.is_none() {
                    prop_assert!(split.error <= 0);
                    prop_assert_eq!(charged, used + split.error.unsigned_abs());
                    prop_assert!(split.error.unsigned_abs() <= TOGETHER * 3 * BRIEF);
                }
            }
        }
    }
}
