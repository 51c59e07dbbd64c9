//! Rounds that a worker begins by the clock alone ([`every`](crate::WorkerBuilder::every)): how
//! many were served, and how many were left out. `round_stats_disabled.rs` takes this file's place
//! in builds without feature `texts`, which have no report of them.

use crate::executor::wake::schedule::Release;
use crate::stats::Counter;
use crate::sync::Arc;
use alloc::string::String;
use core::fmt;

/// The live counters of one worker's rounds; [`RoundStats`] is a snapshot of them.
#[derive(Debug, Default)]
struct RoundCounters {
    served: Counter,
    skipped: Counter,
}

/// The counters, if the worker's rounds begin by the clock.
#[derive(Debug, Default)]
pub(crate) struct RoundCount(Option<Arc<RoundCounters>>);

impl RoundCount {
    /// The rounds are counted from now on.
    pub(crate) fn enable(&mut self) {
        self.0.get_or_insert_default();
    }

    /// Counts a release that is served now.
    pub(crate) fn note(&self, release: Release) {
        if let Some(counters) = &self.0 {
            counters.served.add(1);
            counters.skipped.add(release.skipped);
        }
    }

    /// The counters for the report on these rounds.
    pub(crate) fn of(&self, worker: &Arc<str>) -> Option<WorkerRounds> {
        let counters = Arc::clone(self.0.as_ref()?);
        let worker = Arc::clone(worker);
        Some(WorkerRounds { worker, counters })
    }
}

/// Releases of [`WorkerBuilder::every`](crate::WorkerBuilder::every) since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct RoundStats {
    /// Releases that were served: a round began, if the [trigger](crate::Trigger) allowed it.
    pub served: u64,
    /// Releases that were left out because they were overrun: with
    /// [`Overrun::Skip`](crate::Overrun), the default, alone.
    pub skipped: u64,
}

/// One worker whose rounds begin by the clock.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct RoundReport {
    /// The worker's name.
    pub worker: String,
    /// The releases of its rounds.
    pub stats: RoundStats,
}

impl fmt::Display for RoundReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { worker, stats } = self;
        let (served, skipped) = (stats.served, stats.skipped);
        write!(
            f,
            "{worker}: {served} rounds by the clock, {skipped} skipped"
        )
    }
}

/// The counters of one worker's rounds, with its name.
pub(crate) struct WorkerRounds {
    worker: Arc<str>,
    counters: Arc<RoundCounters>,
}

impl WorkerRounds {
    /// The counters at this moment, if the worker has this name.
    pub(crate) fn stats_of(&self, worker: &str) -> Option<RoundStats> {
        (*self.worker == *worker).then(|| self.stats())
    }

    fn stats(&self) -> RoundStats {
        RoundStats {
            served: self.counters.served.get(),
            skipped: self.counters.skipped.get(),
        }
    }

    pub(crate) fn report(&self) -> RoundReport {
        RoundReport {
            worker: String::from(&*self.worker),
            stats: self.stats(),
        }
    }
}
