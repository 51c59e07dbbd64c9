//! The evidence of one case, and what it says about the machine.

use super::super::child::Reading;
use super::super::timeline::{Piece, Timeline};
use super::Finding;
use crate::load::Nanos;
use serde::{Deserialize, Serialize};

/// Some µs after the enforcer has caught up the workers have, too, which another CPU wakes.
const SETTLING: Nanos = 2_000_000;

/// The evidence of one case.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(in super::super) struct Evidence {
    #[serde(skip)]
    pub timeline: Timeline,
    /// The kernel's id of each worker's thread.
    pub threads: Vec<i32>,
    /// The enforcer's thread of the CPU under test.
    pub enforcer: Option<i32>,
    /// All threads of the child.
    pub own: Vec<i32>,
    /// Between two readings of the CPU clocks, with the whole process stopped.
    pub from: Nanos,
    pub to: Nanos,
    /// Just before the second of the two stops.
    pub ends: Nanos,
    /// The CPU clocks of the workers at both stops, by `/proc`.
    pub clocks: [Vec<Nanos>; 2],
    /// The executor's account, twice.
    pub accounts: [Vec<Reading>; 2],
    /// Stops of the whole process, the first of the two among them.
    pub halts: Vec<Halt>,
}

/// The whole process is stopped for a while.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(in super::super) struct Halt {
    /// Just before it was stopped.
    pub from: Nanos,
    /// Just before it was continued.
    pub continues: Nanos,
    /// When all threads could run again.
    pub to: Nanos,
}

impl Evidence {
    /// The stretches between the stops.
    pub(super) fn spans(&self) -> impl Iterator<Item = (Nanos, Nanos)> {
        let from = std::iter::once(self.from).chain(self.halts.iter().map(|h| h.to));
        let inside = self.halts.iter().map(|h| h.from);
        let to = inside.chain(std::iter::once(self.ends));
        from.zip(to).filter(|(from, to)| from < to)
    }

    /// From when to when no window begins, since the enforcer had not seen all that was due: the
    /// process was stopped, or the kernel took the CPU from the enforcer in the middle of a round.
    pub(super) fn blind(&self) -> Vec<(Nanos, Nanos)> {
        let stops = self.halts.iter().map(|halt| {
            let seen = self.rounds(halt.continues).next();
            (halt.from, seen.unwrap_or(halt.to).max(halt.to) + SETTLING)
        });
        let pieces = self.timeline.pieces.windows(2);
        let cut_short = pieces.filter_map(|pair| match pair {
            [round, next] if round.thread != next.thread && self.enforcer == Some(round.thread) => {
                (!round.waits).then_some(round.to)
            }
            _ => None,
        });
        let rounds = cut_short.map(|at| (at, self.rounds(at).nth(1).unwrap_or(self.to)));
        stops.chain(rounds).collect()
    }

    /// When the enforcer's rounds end that begin, or go on, from this time on.
    fn rounds(&self, from: Nanos) -> impl Iterator<Item = Nanos> {
        let pieces = &self.timeline.pieces;
        let after = pieces.get(pieces.partition_point(|p| p.from < from)..);
        let its = |p: &&Piece| self.enforcer == Some(p.thread) && p.waits;
        after.unwrap_or_default().iter().filter(its).map(|p| p.to)
    }
}

/// The machine stood still, in ns: longest stretch in which a thread ran and its clock did not,
/// or in which the kernel's tick did not come.
pub(in super::super) fn stall(evidence: &Evidence) -> Nanos {
    let pieces = evidence.timeline.pieces.iter().filter(|p| p.thread != 0);
    pieces.map(Piece::wall).max().unwrap_or(0)
}

/// CPU time, in ns, that real-time threads of other programs took of the CPU under test: the run's
/// lock keeps those away that know of it.
pub(in super::super) fn foreign(evidence: &Evidence) -> Nanos {
    let own = |p: &&Piece| p.rank == 0 || evidence.own.contains(&p.thread);
    let pieces = evidence.timeline.pieces.iter();
    let others = pieces.filter(|p| !own(p)).map(Piece::wall);
    // Without its threads none is known to be foreign.
    if evidence.own.is_empty() {
        0
    } else {
        others.sum()
    }
}

/// The threads that had the CPU around a finding, as text: a line for each stretch of one.
pub(in super::super) fn around(
    evidence: &Evidence,
    finding: &Finding,
    before: Nanos,
    after: Nanos,
) -> String {
    let at = evidence.from + finding.at;
    let pieces = evidence.timeline.pieces.iter();
    let near = pieces.filter(|p| p.to + before >= at && p.from <= at + after);
    let line = |p: &Piece| {
        let who = evidence.threads.iter().position(|t| *t == p.thread);
        let who = who.map_or_else(|| p.thread.to_string(), super::super::case::name);
        format!(
            "{:.6} +{:.1} us: {who} at {}, {:.1} us{}{}\n",
            (p.from as f64 - evidence.from as f64) / 1e9,
            p.wall() as f64 / 1e3,
            p.rank,
            p.cpu as f64 / 1e3,
            if p.waits { ", then waits" } else { "" },
            if p.withheld { ", withheld" } else { "" },
        )
    };
    near.map(line).collect()
}
