//! How the machine disturbed a case, and whether the case counts all the same.
//!
//! | the machine | a case that holds | that breaks | with a fault of the program |
//! |---|---|---|---|
//! | real-time threads of other programs had a second | again | again | again |
//! | records were lost, or a tenth of the time stolen | again | again | counts |
//! | stood still for more than 10 ms, or 40 ms stolen | counts | again | counts |
//! | did its part | counts | counts | counts |
//!
//! The bounds allow for each standstill that the trace shows: a case that holds beside them holds.

use super::judge;
use super::trial::Shown;
use crate::load::{MS, Nanos};
use std::fmt;

/// A standstill of this length may break a case.
const STALL: Nanos = 10 * MS;
/// So may the theft of this much time; the kernel counts it in steps of 10 ms.
const STOLEN: Nanos = 40 * MS;
/// After the theft of one part of so many, nothing that a case shows counts.
const STOLEN_PART: Nanos = 10;
/// Nor does it beside real-time threads of other programs that took this much of the CPU.
const FOREIGN: Nanos = 1_000 * MS;

/// The disturbances of one case.
#[derive(Clone, Copy)]
pub(super) struct Disturbance {
    /// The longest standstill.
    stall: Nanos,
    /// CPU time that the hypervisor took.
    stolen: Nanos,
    /// CPU time that real-time threads of other programs took.
    foreign: Nanos,
    /// The kernel lost records of the trace.
    lost: bool,
    /// The length of the case.
    lasted: Nanos,
}

impl Disturbance {
    pub(super) fn of(shown: &Shown, seconds: u64) -> Self {
        Self {
            stall: judge::stall(&shown.evidence),
            stolen: shown.stolen,
            foreign: judge::foreign(&shown.evidence),
            lost: shown.evidence.timeline.lost,
            lasted: seconds * 1_000 * MS,
        }
    }

    /// Whether nothing that the case shows counts. Beside others not even a fault of the program
    /// does.
    pub(super) const fn voids(&self, has_faults: bool) -> bool {
        let gone = self.lost || self.stolen > self.lasted / STOLEN_PART;
        gone && !has_faults || self.foreign > FOREIGN
    }

    /// Whether a promise may be broken because of it.
    pub(super) const fn excuses(&self) -> bool {
        self.stall > STALL || self.stolen >= STOLEN
    }
}

impl fmt::Display for Disturbance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "the machine stood still for {} ms, {} ms were stolen, lost: {}; foreign real-time \
             threads had {} ms",
            self.stall / MS,
            self.stolen / MS,
            self.lost,
            self.foreign / MS
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CALM: Disturbance = Disturbance {
        stall: STALL,
        stolen: STOLEN - 1,
        foreign: FOREIGN,
        lost: false,
        lasted: 20_000 * MS,
    };

    /// Whether a case counts without a fault and with one, and whether a broken promise does.
    fn counts(machine: Disturbance) -> (bool, bool, bool) {
        let [whole, faulty] = [false, true].map(|faults| !machine.voids(faults));
        (whole, faulty, whole && !machine.excuses())
    }

    #[test]
    fn what_a_disturbed_case_shows_counts_if_it_holds() {
        assert_eq!(counts(CALM), (true, true, true));
        let stall = Disturbance {
            stall: STALL + 1,
            ..CALM
        };
        assert_eq!(counts(stall), (true, true, false));
        let stolen = |stolen| Disturbance { stolen, ..CALM };
        assert_eq!(counts(stolen(STOLEN)), (true, true, false));
        assert_eq!(counts(stolen(2_000 * MS)), (true, true, false));
        assert_eq!(counts(stolen(2_000 * MS + 1)), (false, true, false));
        let lost = Disturbance { lost: true, ..CALM };
        assert_eq!(counts(lost), (false, true, false));
        let foreign = Disturbance {
            foreign: FOREIGN + 1,
            ..CALM
        };
        assert_eq!(counts(foreign), (false, false, false));
    }
}
