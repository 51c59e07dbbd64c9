//! Pieces of one CPU's time, each of one thread, and the standstills of the machine.

use crate::load::Nanos;

/// The enforcer's priority: no worker and no stranger has it of its own.
pub(super) const ENFORCER: u8 = 99;

/// A stretch of one thread on the traced CPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Piece {
    /// The kernel's id; 0 is the idle thread.
    pub thread: i32,
    /// Its effective real-time priority; 0 without one.
    pub rank: u8,
    pub from: Nanos,
    pub to: Nanos,
    /// The advance of its CPU clock, which may have begun some µs before `from`.
    pub cpu: Nanos,
    /// The thread waits afterwards, by itself: it was not stopped with its process.
    pub waits: bool,
    /// A more urgent thread of the case wanted the CPU, and the kernel did not let it (throttle,
    /// fair server).
    pub withheld: bool,
}

impl Piece {
    pub(crate) fn wall(&self) -> Nanos {
        self.to.saturating_sub(self.from)
    }
}

/// The pieces of one CPU, in order.
#[derive(Debug, Default)]
pub(crate) struct Timeline {
    pub pieces: Vec<Piece>,
    /// From when to when the machine stood still, by the sign of a timer's interrupt that came late
    /// or of a thread that was charged for more than the time it had. In order, apart.
    pub still: Vec<(Nanos, Nanos)>,
    /// The kernel had no room for some records: nothing can be said.
    pub lost: bool,
}

impl Timeline {
    /// The end of a standstill that ended at that time, or of a stretch in which the kernel kept
    /// the enforcer waiting. The enforcer decides by the time at which it began: what falls due
    /// while it stands still waits until it has come to its end.
    pub(crate) fn judged_until(&self, at: Nanos) -> Nanos {
        let amid = self.pieces.partition_point(|p| p.to <= at);
        let after = self.pieces.get(amid..).unwrap_or_default();
        let begun = after.first().is_some_and(|p| p.from <= at);
        let its = after.iter().take_while(|p| begun && p.rank == ENFORCER);
        its.last().map_or(at, |p| p.to)
    }

    /// Time that the machine stood still in a stretch of time.
    pub(crate) fn stood_still(&self, from: Nanos, to: Nanos) -> Nanos {
        let overlap = |(began, ended): (Nanos, Nanos)| ended.min(to) - began.max(from);
        self.still_in(from, to).map(overlap).sum()
    }

    /// The times at which the machine stood still, if only for a part of this stretch.
    pub(crate) fn still_in(&self, from: Nanos, to: Nanos) -> impl Iterator<Item = (Nanos, Nanos)> {
        let first = self.still.partition_point(|&(_, ended)| ended <= from);
        let after = self.still.get(first..).unwrap_or_default().iter().copied();
        after.take_while(move |&(began, _)| began < to)
    }
}
