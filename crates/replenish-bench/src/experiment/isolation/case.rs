//! The windows of one case: a disturbance, without or with budgets.

use super::scenario::{Disturbance, PERIOD, Response};
use crate::load::Nanos;

/// All windows of one case.
#[derive(Debug, Clone)]
pub(super) struct Case {
    pub(super) disturbance: Disturbance,
    pub(super) budgets: bool,
    pub(super) responses: Vec<Response>,
    pub(super) windows: u64,
    pub(super) windows_repeated: u64,
    /// Windows that count although the machine stood still, since too many had been repeated.
    pub(super) windows_stalled: u64,
    pub(super) sent: u64,
    pub(super) deferred: bool,
    pub(super) fallbacks: Vec<String>,
}

impl Case {
    pub(super) fn worst(&self) -> Nanos {
        self.responses.iter().map(|r| r.took).max().unwrap_or(0)
    }

    pub(super) fn misses(&self) -> usize {
        let late = |r: &&Response| !r.ended || r.took > PERIOD;
        self.responses.iter().filter(late).count()
    }
}
