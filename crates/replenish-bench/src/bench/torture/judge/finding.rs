//! A promise, its bound, and what was measured.

use super::super::timeline::PUNCTUAL;
use crate::load::Nanos;
use serde::Serialize;
use sporadic::Tuning;

/// An activation comes so late, and the end of a budget, too: an interrupt and a switch of threads,
/// each of which the trace tells if it takes longer.
pub(super) const LATE: Nanos = 2 * PUNCTUAL;

/// From the beginning of an activation to the end of its budget, beyond the budget: the derivation
/// stands in `docs/enforcement.md`.
pub(super) fn latency(budget: Nanos) -> Nanos {
    2 * LATE + Tuning::LINUX.for_budget(budget).slack
}

/// A promise, its bound, and what was measured.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(in super::super) struct Finding {
    pub promise: &'static str,
    /// The worker.
    pub worker: usize,
    pub bound: Nanos,
    pub measured: Nanos,
    /// When, from the start of what was judged.
    pub at: Nanos,
}

impl Finding {
    /// By how much the bound is exceeded, in ns; negative if it is kept.
    pub(in super::super) fn beyond(&self) -> i64 {
        i64::try_from(self.measured).unwrap_or(i64::MAX)
            - i64::try_from(self.bound).unwrap_or(i64::MAX)
    }
}
