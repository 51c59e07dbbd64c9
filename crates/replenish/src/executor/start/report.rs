//! The report of an executor: plain numbers. `report_text` prints them.

use crate::Nanos;
use crate::chain::ChainReport;
use crate::executor::describe::planning::AdmissionReport;
use crate::executor::handles::state::HandleState;
use crate::executor::run::dispatcher::DispatcherCounters;
use crate::executor::run::round_stats::RoundReport;
use crate::histogram::Histogram;
use crate::middleware::Middleware;
use crate::platform::Text;
use crate::stats::HandleStats;
use alloc::string::String;
use alloc::vec::Vec;
use replenish_os::{Enforcement, EnforcerStats, OverrunSummary, Usage};

/// Everything an executor knows about itself, at one moment or at its end.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Report {
    /// Nanoseconds since the start.
    pub elapsed: Nanos,
    /// The dispatcher first, then the workers in the order they were described.
    pub threads: Vec<ThreadReport>,
    /// The handles, worker by worker, in the order they were added.
    pub handles: Vec<HandleReport>,
    /// The workers whose rounds begin by the clock
    /// ([`WorkerBuilder::every`](crate::WorkerBuilder::every)).
    pub rounds: Vec<RoundReport>,
    /// The dispatcher's counters.
    pub dispatcher: DispatcherReport,
    /// Counters of the enforcers, one per CPU with budgeted workers.
    pub enforcers: Vec<EnforcerStats>,
    /// Guarantees that were asked for and are not in force, in words.
    pub fallbacks: Vec<Text>,
    /// The chains that are measured.
    pub chains: Vec<ChainReport>,
    /// Whether and how guarantees were tested.
    pub admission: AdmissionReport,
    /// Threads that did not end in time; they were demoted and left behind.
    pub stuck: Vec<String>,
}

/// The counters of the dispatcher.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct DispatcherReport {
    /// Times its wait on the middleware ended.
    pub rounds: u64,
    /// Samples taken. Workers take some themselves, which are not among them.
    pub samples: u64,
    /// Times the middleware could not wait or take.
    pub failures: u64,
}

/// A thread's request, the policy it was granted, and its usage.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ThreadReport {
    /// `dispatcher`, or the worker's name.
    pub name: String,
    /// The policy that was asked for.
    pub requested: Text,
    /// The policy the kernel gave, read back from it before the first callback.
    pub granted: Text,
    /// The CPU it was pinned to.
    pub cpu: Option<usize>,
    /// Mode in which its budget is held; `None` without a budget.
    pub enforcement: Option<Enforcement>,
    /// CPU time and budget.
    pub usage: Usage,
    /// Overruns of the budget.
    pub overruns: OverrunSummary,
}

/// Report of one handle.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct HandleReport {
    /// `/node/sub:/topic`, `worker/timer:0`.
    pub id: String,
    /// Its worker's name.
    pub worker: String,
    /// Its counters.
    pub stats: HandleStats,
    /// Times from release (arrival, timer's release) to the start of the callback.
    pub latency: Histogram,
    /// Times from release to the end of the callback.
    pub response: Histogram,
    /// Bytes that were taken at set-up for its samples, those of the middleware included.
    pub memory: usize,
    /// Number of publishers (for a service: clients) of its subscription; `None` for a handle
    /// without a subscription, and where the middleware does not know it: DDS-XRCE.
    pub matched: Option<usize>,
    /// The last error a callback returned, or the panic's message; cut to 120 bytes.
    pub last_error: Option<String>,
}

impl DispatcherReport {
    pub(crate) fn of(counters: &DispatcherCounters) -> Self {
        Self {
            rounds: counters.rounds.get(),
            samples: counters.samples.get(),
            failures: counters.failures.get(),
        }
    }
}

impl HandleReport {
    pub(crate) fn of(worker: &str, handle: &HandleState, middleware: &dyn Middleware) -> Self {
        let error = String::from(handle.last_error.lock().as_str());
        Self {
            id: handle.id.clone(),
            worker: worker.into(),
            stats: handle.stats(middleware),
            latency: handle.latency.snapshot(),
            response: handle.response.snapshot(),
            memory: handle.memory(middleware),
            matched: handle.matched(middleware),
            last_error: Some(error).filter(|e| !e.is_empty()),
        }
    }
}

impl Report {
    /// The handle of this id.
    #[must_use]
    pub fn handle(&self, id: &str) -> Option<&HandleReport> {
        self.handles.iter().find(|h| h.id == id)
    }

    /// The chain of this name.
    #[must_use]
    pub fn chain(&self, name: &str) -> Option<&ChainReport> {
        self.chains.iter().find(|c| c.name == name)
    }

    /// The thread of this name.
    #[must_use]
    pub fn thread(&self, name: &str) -> Option<&ThreadReport> {
        self.threads.iter().find(|t| t.name == name)
    }
}
