//! Overruns of budgets: the last ones exactly, in fixed memory.

use alloc::vec::Vec;

/// Number of a worker's newest overruns that are kept.
const KEPT: usize = crate::backend::config::OVERRUNS_KEPT;

/// Number of a worker's newest stalls that are kept.
const STALLS_KEPT: usize = if KEPT < 1024 { 2 } else { 16 };

/// A demotion that came late because the machine stood still (a hypervisor pause, the kernel's
/// real-time throttle): listed apart from the mechanism's own overruns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stall {
    /// Delay of the enforcer, in nanoseconds of wall time.
    pub late: u64,
    /// CPU time beyond the budget that the worker consumed meanwhile, in nanoseconds.
    pub overrun: i64,
}

/// CPU time consumed at the high priority beyond the budget, per exhaustion, in nanoseconds.
///
/// Negative where the worker was stopped early by less than the slack. Debt is carried: an
/// overrun is paid back, so these figures describe jitter, not lost isolation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OverrunSummary {
    /// Exhaustions seen in all, stalls not counted.
    pub count: u64,
    /// Median of the newest 1024.
    pub median: i64,
    /// 99th percentile of the newest 1024.
    pub p99: i64,
    /// Largest of the newest 1024.
    pub max: i64,
    /// Number of demotions that were late by more than [`STALL`] nanoseconds.
    pub stalls: u64,
    /// The worst of these stalls.
    pub worst_stall: Option<Stall>,
}

/// The single overruns behind an [`OverrunSummary`], so that several workers can be summed up.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OverrunSamples {
    /// The newest 1024 overruns in nanoseconds, in no order, stalls not among them.
    pub overruns: Vec<i64>,
    /// The newest 16 stalls, in no order.
    pub stalls: Vec<Stall>,
}

/// The least lateness in ns of a demotion that counts as a stall: 500 µs, far above the mechanism's
/// own.
pub const STALL: u64 = 500_000;

/// The newest overruns of one worker.
#[derive(Debug)]
pub(crate) struct Overruns {
    ring: [i64; KEPT],
    count: u64,
    stalls: u64,
    worst: Option<Stall>,
    newest_stalls: [Stall; STALLS_KEPT],
}

/// Nothing recorded yet.
impl Default for Overruns {
    fn default() -> Self {
        Self {
            ring: [0; KEPT],
            count: 0,
            stalls: 0,
            worst: None,
            newest_stalls: const {
                [Stall {
                    late: 0,
                    overrun: 0,
                }; STALLS_KEPT]
            },
        }
    }
}

impl Overruns {
    pub(crate) fn record(&mut self, overrun: i64, late: u64) {
        if late > STALL {
            let stall = Stall { late, overrun };
            let slot = usize::try_from(self.stalls % STALLS_KEPT as u64).unwrap_or(0);
            if let Some(place) = self.newest_stalls.get_mut(slot) {
                *place = stall;
            }
            self.stalls += 1;
            if self.worst.is_none_or(|w| late > w.late) {
                self.worst = Some(stall);
            }
            return;
        }
        let slot = usize::try_from(self.count % KEPT as u64).unwrap_or(0);
        if let Some(place) = self.ring.get_mut(slot) {
            *place = overrun;
        }
        self.count += 1;
    }

    /// Copies what is kept into `out` (cleared first) and returns the totals; the caller sorts
    /// outside the lock.
    pub(crate) fn copy_into(&self, out: &mut Vec<i64>) -> (u64, u64, Option<Stall>) {
        let kept = usize::try_from(self.count).unwrap_or(KEPT).min(KEPT);
        out.clear();
        out.extend(self.ring.iter().take(kept));
        (self.count, self.stalls, self.worst)
    }

    /// Stalls seen in all.
    pub(crate) const fn stalls(&self) -> u64 {
        self.stalls
    }

    /// The newest stalls, in no order. Does not allocate: called under the enforcer's lock.
    pub(crate) fn newest_stalls(&self) -> ([Stall; STALLS_KEPT], usize) {
        let kept = usize::try_from(self.stalls).unwrap_or(STALLS_KEPT);
        (self.newest_stalls, kept.min(STALLS_KEPT))
    }
}

/// Sorts the sample and sums it up.
pub(crate) fn summarise(
    sample: &mut [i64],
    (count, stalls, worst_stall): (u64, u64, Option<Stall>),
) -> OverrunSummary {
    sample.sort_unstable();
    let at = |percent: usize| {
        let rank = (sample.len() * percent).div_ceil(100).max(1) - 1;
        sample.get(rank).copied().unwrap_or(0)
    };
    OverrunSummary {
        count,
        median: at(50),
        p99: at(99),
        max: at(100),
        stalls,
        worst_stall,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;

    #[test]
    fn percentiles_are_those_of_the_newest_and_stalls_stand_apart() {
        let mut o = Overruns::default();
        for i in 0..2048 {
            o.record(i, 0);
        }
        o.record(9_999_999, STALL + 1);
        let mut sample = Vec::new();
        let totals = o.copy_into(&mut sample);
        let s = summarise(&mut sample, totals);
        assert_eq!((s.count, s.stalls), (2048, 1));
        assert_eq!((s.median, s.max), (1024 + 511, 2047));
        assert_eq!(s.p99, 1024 + 1013);
        assert_eq!(
            s.worst_stall,
            Some(Stall {
                late: STALL + 1,
                overrun: 9_999_999
            })
        );
    }

    #[test]
    fn a_demotion_late_by_the_limit_is_no_stall_and_the_latest_is_the_worst() {
        let mut o = Overruns::default();
        o.record(7, STALL);
        let delays = [3, 9, 9, 5];
        for (overrun, late) in (0..).zip(delays) {
            o.record(overrun, STALL + late);
        }
        let mut sample = Vec::new();
        let (count, stalls, worst) = o.copy_into(&mut sample);
        assert_eq!((count, stalls, sample), (1, 4, vec![7]));
        let (late, overrun) = (STALL + 9, 1);
        assert_eq!(worst, Some(Stall { late, overrun }), "the first of two");
    }

    #[test]
    fn the_newest_stalls_are_kept() {
        let mut o = Overruns::default();
        for overrun in 0..20 {
            o.record(overrun, STALL + 1);
        }
        let (stalls, kept) = o.newest_stalls();
        let mut overruns: Vec<_> = stalls[..kept].iter().map(|s| s.overrun).collect();
        overruns.sort_unstable();
        assert_eq!(overruns, (4..20).collect::<Vec<_>>());
    }

    #[test]
    fn nothing_recorded_is_all_zero() {
        let mut sample = Vec::new();
        let totals = Overruns::default().copy_into(&mut sample);
        assert_eq!(summarise(&mut sample, totals), OverrunSummary::default());
    }
}
