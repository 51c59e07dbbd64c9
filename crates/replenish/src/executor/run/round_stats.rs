//! Rounds that a worker begins by the clock alone ([`every`](crate::WorkerBuilder::every)): how
//! many, and how many were left out. Builds without feature `texts`, which have no report of them,
//! count none.

use crate::executor::wake::schedule::Release;
use crate::stats::Counter;
use crate::sync::Arc;
use alloc::string::String;

/// The live counters; [`RoundStats`] is a snapshot of them.
#[derive(Debug, Default)]
pub(crate) struct RoundCounters {
    served: Counter,
    skipped: Counter,
}

/// What has become of the releases of [`WorkerBuilder::every`](crate::WorkerBuilder::every) since
/// the start.
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
    /// What has become of the releases.
    pub stats: RoundStats,
}

impl RoundCounters {
    /// This one is served now.
    pub(crate) fn note(&self, release: Release) {
        self.served.add(1);
        self.skipped.add(release.skipped);
    }

    pub(crate) fn snapshot(&self) -> RoundStats {
        RoundStats {
            served: self.served.get(),
            skipped: self.skipped.get(),
        }
    }
}

/// Of one worker.
pub(crate) type WorkerRounds = (Arc<str>, Arc<RoundCounters>);

pub(crate) fn report((worker, counters): &WorkerRounds) -> RoundReport {
    RoundReport {
        worker: String::from(&**worker),
        stats: counters.snapshot(),
    }
}
