//! One worker's evidence.

use super::super::case::{Case, Worker};
use super::super::timeline::Piece;
use super::{Evidence, Finding};
use crate::load::Nanos;

/// The worst finding for each promise and worker, kept or not.
pub(in super::super) fn judge(case: &Case, evidence: &Evidence) -> Vec<Finding> {
    let blind = evidence.blind();
    let mut found = Vec::new();
    for (index, worker) in case.workers.iter().enumerate() {
        let Some(thread) = evidence.threads.get(index).copied() else {
            continue;
        };
        let view = View {
            evidence,
            blind: &blind,
            worker,
            index,
            thread,
        };
        if let Some(inherits) = case.inherits(worker) {
            found.extend(view.upper(inherits));
        }
        found.extend(view.share(case));
        found.extend(view.account());
        found.extend(view.trace());
    }
    found
}

/// One worker's evidence.
pub(super) struct View<'e> {
    pub(super) evidence: &'e Evidence,
    /// See [`Evidence::blind`].
    blind: &'e [(Nanos, Nanos)],
    pub(super) worker: &'e Worker,
    pub(super) index: usize,
    pub(super) thread: i32,
}

impl View<'_> {
    pub(super) fn finding(
        &self,
        promise: &'static str,
        bound: Nanos,
        measured: Nanos,
        at: Nanos,
    ) -> Finding {
        Finding {
            promise,
            worker: self.index,
            bound,
            measured,
            at: at.saturating_sub(self.evidence.from),
        }
    }

    pub(super) fn pieces(&self) -> impl Iterator<Item = &Piece> {
        let (from, to) = (self.evidence.from, self.evidence.to);
        let pieces = self.evidence.timeline.pieces.iter();
        pieces.filter(move |p| from <= p.from && p.to <= to)
    }

    pub(super) fn is_high(&self, piece: &Piece) -> bool {
        piece.thread == self.thread && piece.rank > self.worker.background.unwrap_or(1)
    }

    /// Whether the enforcer may not have acted yet on all that was due.
    pub(super) fn settles(&self, at: Nanos) -> bool {
        self.blind.iter().any(|&(from, to)| from <= at && at < to)
    }
}

/// The amount that `budget` in every `period` comes to in `time`.
pub(super) fn share_of_time(time: Nanos, budget: Nanos, period: Nanos) -> Nanos {
    let share = u128::from(time) * u128::from(budget) / u128::from(period);
    u64::try_from(share).unwrap_or(Nanos::MAX)
}
