//! The samples that were acknowledged or have arrived, and the soak's verdict.

use std::ops::Range;
use std::time::{Duration, Instant};

/// Numbers beyond are not the soak's.
const MOST: usize = 1 << 27;

/// The samples by number.
#[derive(Debug)]
pub(super) struct Ledger {
    arrived: Vec<u8>,
    acknowledged: Vec<Range<u32>>,
    not_covered: Vec<Range<u32>>,
    damaged: u64,
    foreign: u64,
    ready: bool,
    last: Instant,
    longest: Duration,
}

/// The verdict. The names are a contract.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub(super) struct Verdict {
    /// Samples acknowledged for certain.
    pub(super) acknowledged: u64,
    /// Of these, samples that arrived once.
    pub(super) once: u64,
    /// Samples that arrived twice.
    pub(super) twice: u64,
    /// Samples that arrived more often.
    pub(super) more: u64,
    /// Acknowledged samples that did not arrive.
    pub(super) missing: u64,
    /// Samples that did not arrive and that no promise covers: the reader returned too late.
    pub(super) not_covered: u64,
    /// Samples that arrived damaged, or that no publisher wrote.
    pub(super) damaged: u64,
}

impl Ledger {
    pub(super) fn new() -> Self {
        Self {
            arrived: Vec::new(),
            acknowledged: Vec::new(),
            not_covered: Vec::new(),
            damaged: 0,
            foreign: 0,
            ready: false,
            last: Instant::now(),
            longest: Duration::ZERO,
        }
    }

    /// A sample has arrived.
    pub(super) fn arrive(&mut self, number: u32) {
        let at = number as usize;
        if number == super::part::READY {
            self.ready = true;
            return;
        }
        if number == super::part::DAMAGED {
            self.damaged += 1;
            return;
        }
        if at >= MOST {
            self.foreign += 1;
            return;
        }
        if self.arrived.len() <= at {
            self.arrived.resize(at + 1, 0);
        }
        if let Some(times) = self.arrived.get_mut(at) {
            *times = times.saturating_add(1);
        }
        self.longest = self.longest.max(self.last.elapsed());
        self.last = Instant::now();
    }

    /// Whether the reader is there.
    pub(super) fn is_ready(&self) -> bool {
        self.ready
    }

    /// Begins to look for the longest time without a sample.
    pub(super) fn mark(&mut self) {
        (self.last, self.longest) = (Instant::now(), Duration::ZERO);
    }

    /// The longest time without a sample since then, up to the last one that arrived.
    pub(super) fn longest(&self) -> Duration {
        self.longest
    }

    /// These are acknowledged.
    pub(super) fn acknowledge(&mut self, numbers: Range<u32>) {
        self.acknowledged.push(numbers);
    }

    /// Excuses these samples: no promise covers them if they do not arrive.
    pub(super) fn excuse(&mut self, numbers: Range<u32>) {
        self.not_covered.push(numbers);
    }

    fn times(&self, number: u32) -> u8 {
        self.arrived.get(number as usize).copied().unwrap_or(0)
    }

    /// Whether all of these have arrived, or none of them is promised.
    pub(super) fn has(&self, mut numbers: Range<u32>) -> bool {
        numbers.all(|number| self.times(number) > 0 || self.is_excused(number))
    }

    fn is_excused(&self, number: u32) -> bool {
        self.not_covered.iter().any(|range| range.contains(&number))
    }

    pub(super) fn verdict(&self) -> Verdict {
        let count =
            |wanted: fn(&u8) -> bool| self.arrived.iter().filter(|t| wanted(t)).count() as u64;
        let acknowledged = || self.acknowledged.iter().cloned().flatten();
        let lacking = || acknowledged().filter(|number| self.times(*number) == 0);
        let not_covered = lacking().filter(|number| self.is_excused(*number)).count() as u64;
        Verdict {
            acknowledged: acknowledged().count() as u64,
            once: acknowledged()
                .filter(|number| self.times(*number) == 1)
                .count() as u64,
            twice: count(|times| *times == 2),
            more: count(|times| *times > 2),
            missing: lacking().count() as u64 - not_covered,
            not_covered,
            damaged: self.damaged + self.foreign,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_what_came_again_and_what_is_not_covered() {
        let mut ledger = Ledger::new();
        [0, 1, 1, 3, 3, 3]
            .into_iter()
            .for_each(|number| ledger.arrive(number));
        ledger.arrive(super::super::part::DAMAGED);
        ledger.acknowledge(0..6);
        assert!(!ledger.has(0..6) && ledger.has(0..2));
        ledger.excuse(4..10);
        let verdict = Verdict {
            acknowledged: 6,
            once: 1,
            twice: 1,
            more: 1,
            missing: 1, // 2
            not_covered: 2,
            damaged: 1,
        };
        assert_eq!(ledger.verdict(), verdict);
    }
}
