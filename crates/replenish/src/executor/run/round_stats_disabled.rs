//! In the place of `round_stats` in builds without feature `texts`: rounds are not counted.

use crate::executor::wake::schedule::Release;
use crate::sync::Arc;
use core::fmt;

/// Counts nothing.
#[derive(Debug, Default)]
pub(crate) struct RoundCount;

impl RoundCount {
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn enable(&mut self) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn note(&self, _: Release) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn of(&self, _: &Arc<str>) -> Option<WorkerRounds> {
        None
    }
}

/// Nothing is counted in this build.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RoundStats {}

/// There is no such report in this build.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RoundReport {}

impl fmt::Display for RoundReport {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

/// No worker's rounds are counted.
pub(crate) enum WorkerRounds {}

impl WorkerRounds {
    pub(crate) const fn stats_of(&self, _: &str) -> Option<RoundStats> {
        match *self {}
    }

    pub(crate) const fn report(&self) -> RoundReport {
        match *self {}
    }
}
