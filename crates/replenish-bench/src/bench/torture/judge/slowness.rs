//! How slow the machine was around a finding, by the enforcer's rounds.

use super::{Evidence, Finding};
use crate::load::Nanos;

/// Fewer rounds of the enforcer than this say nothing about the machine.
const ROUNDS: usize = 3;

/// How many times as long as in the whole case the enforcer's rounds took around a finding, each by
/// the median. The code is the same, so a machine that is short of caches or of cycles shows here,
/// which stands still nowhere. `None`: there are too few rounds.
pub(in super::super) fn slowness(
    evidence: &Evidence,
    finding: &Finding,
    around: Nanos,
) -> Option<f64> {
    let at = evidence.from + finding.at;
    let here = median(evidence, at.saturating_sub(around), at + around)?;
    let ever = median(evidence, 0, Nanos::MAX)?;
    Some(here as f64 / ever.max(1) as f64)
}

/// The CPU time of the enforcer's rounds in this time.
fn median(evidence: &Evidence, from: Nanos, to: Nanos) -> Option<Nanos> {
    let pieces = evidence.timeline.pieces.iter();
    let rounds = pieces.filter(|p| evidence.enforcer == Some(p.thread) && p.waits);
    let within = rounds.filter(|p| p.to >= from && p.from <= to);
    let mut took: Vec<_> = within.map(|p| p.cpu).collect();
    took.sort_unstable();
    let middle = took.get(took.len() / 2).copied();
    middle.filter(|_| took.len() >= ROUNDS)
}

#[cfg(test)]
mod tests {
    use super::super::super::timeline::Piece;
    use super::*;

    const MS: Nanos = 1_000_000;

    /// A round of the enforcer.
    fn round(at: Nanos, cpu: Nanos) -> Piece {
        Piece {
            thread: 3,
            rank: 99,
            from: at,
            to: at + cpu,
            cpu,
            waits: true,
            withheld: false,
        }
    }

    /// Torture, seed 149: each step, the enforcer's and the worker's, took three to five times as
    /// long as elsewhere in the same trace.
    #[test]
    fn a_machine_that_is_slow_around_a_finding_is_seen_by_the_enforcers_rounds() {
        let mut evidence = Evidence::default();
        let took = |ms| {
            if (500..510).contains(&ms) {
                50_000
            } else {
                20_000
            }
        };
        evidence.timeline.pieces = (1..1000).map(|ms| round(ms * MS, took(ms))).collect();
        let slow = |evidence: &Evidence, at, around| {
            let finding = Finding {
                promise: "window",
                worker: 0,
                bound: 0,
                measured: 1,
                at,
            };
            slowness(evidence, &finding, around)
        };
        assert_eq!(slow(&evidence, 505 * MS, 4 * MS), None, "no enforcer");
        evidence.enforcer = Some(3);
        assert_eq!(slow(&evidence, 505 * MS, 4 * MS), Some(2.5));
        assert_eq!(slow(&evidence, 400 * MS, 4 * MS), Some(1.0));
        assert_eq!(slow(&evidence, 400 * MS, MS / 2), None, "one round");
    }
}
