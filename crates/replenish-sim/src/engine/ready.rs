//! The list of ready threads, most urgent first, with the queue positions POSIX gives them.
//!
//! A running thread stays in the list. One that is preempted therefore keeps its place before its
//! equals, and one that leaves and comes back joins behind them (POSIX XSH 2.8.4, `SCHED_FIFO`).

use super::phase::Rank;
use crate::End;

#[derive(Debug, Default)]
pub(super) struct Ready(Vec<(Rank, usize)>);

impl Ready {
    /// Adds a thread before or behind its equals.
    pub(super) fn insert(&mut self, rank: Rank, id: usize, end: End) {
        let at = match end {
            End::Head => self.0.partition_point(|&(other, _)| other > rank),
            End::Tail => self.0.partition_point(|&(other, _)| other >= rank),
        };
        self.0.insert(at, (rank, id));
    }

    pub(super) fn remove(&mut self, id: usize) {
        if let Some(at) = self.0.iter().position(|&(_, other)| other == id) {
            self.0.remove(at);
        }
    }

    /// All ready threads, most urgent first.
    pub(super) fn iter(&self) -> impl Iterator<Item = usize> + '_ {
        self.0.iter().map(|&(_, id)| id)
    }
}
