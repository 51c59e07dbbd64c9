//! An executor that runs: watching it, and ending it for certain.
//!
//! ```text
//!   running ── stop requested ──► grace: callbacks finish, waits for budget end
//!                                    │ all back                │ grace over
//!                                    ▼                         ▼
//!                                  join                stuck ones: unsupervised, demoted to
//!                                                      time sharing, left behind; join the rest
//! ```

use super::report::{DispatcherReport, HandleReport, Report, ThreadReport};
use super::threads::{Ready, ThreadPlan};
use crate::Nanos;
use crate::context::Claim;
use crate::event::{Event, Events};
#[cfg(feature = "full")]
use crate::executor::change::live::ExecutorHandle;
use crate::executor::change::live::Live;
use crate::executor::describe::planning::Admission;
use crate::executor::handles::state::HandleState;
use crate::executor::run::dispatcher::DispatcherCounters;
#[cfg(feature = "texts")]
use crate::executor::run::round_stats::{self, RoundStats, WorkerRounds};
use crate::executor::wake::schedule::nanos;
use crate::executor::wake::stop::StopHandle;
use crate::platform::{Static, Text, text};
use crate::stats::HandleStats;
use crate::sync::{Arc, Notify};
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use core::time::Duration;
use replenish_os::clock;
use replenish_os::{self as os, Enforcer, SchedClass, Thread, Usage};

/// How long threads that have finished their work may take to end, in nanoseconds.
const EPILOGUE: Nanos = 20_000_000;

/// A thread and its place.
pub(crate) struct StartedThread {
    pub(crate) plan: Arc<ThreadPlan>,
    thread: Thread<()>,
}

impl StartedThread {
    pub(crate) fn new(plan: Arc<ThreadPlan>, thread: Thread<()>) -> Self {
        Self { plan, thread }
    }

    /// Waits for the end of a thread that has finished its work; its panics are events already.
    pub(crate) fn join(self) {
        self.thread.join().ok();
    }
}

/// By CPU, `None` for threads that are not pinned; without one where it was refused.
pub(crate) type Enforcers = Vec<(Option<usize>, Option<Arc<Enforcer>>)>;

/// An executor that runs. Dropping it stops it.
#[must_use = "dropping it stops the executor"]
pub struct RunningExecutor {
    pub(crate) stop: StopHandle,
    pub(crate) owner: Arc<Notify>,
    pub(crate) threads: Vec<StartedThread>,
    pub(crate) enforcers: Enforcers,
    pub(crate) live: Arc<Live>,
    pub(crate) counters: Arc<DispatcherCounters>,
    pub(crate) fallbacks: Vec<Text>,
    pub(crate) stuck: Vec<String>,
    pub(crate) events: Arc<Events>,
    pub(crate) grace: Duration,
    pub(crate) claim: Option<Claim>,
    pub(crate) admission: Static<Admission>,
    #[cfg(feature = "texts")]
    pub(crate) rounds: Vec<WorkerRounds>,
    pub(crate) template: Static<String>,
    pub(crate) start: Nanos,
    pub(crate) end: Option<Report>,
}

impl RunningExecutor {
    /// Stops this executor from anywhere.
    #[must_use]
    pub fn stop_handle(&self) -> StopHandle {
        self.stop.clone()
    }

    /// Adds and removes handles while it runs.
    #[cfg(feature = "full")]
    #[must_use]
    pub fn handle(&self) -> ExecutorHandle {
        ExecutorHandle {
            live: Arc::clone(&self.live),
        }
    }

    /// Stops, joins and reports: within the grace period plus a few milliseconds, whatever the
    /// callbacks do. In a callback of this executor it waits for all threads but that of the
    /// callback, which is reported as stuck: [`StopHandle`] is for callbacks.
    pub fn stop(mut self) -> Report {
        self.stop.stop();
        self.finish()
    }

    /// Blocks until somebody stops the executor, then joins and reports.
    pub fn wait(mut self) -> Report {
        while !self.stop.is_stopping() {
            self.owner.wait();
        }
        self.finish()
    }

    /// The numbers at this moment. Allocates; takes no lock that a callback could wait for long.
    #[must_use]
    pub fn report(&self) -> Report {
        let threads = self.threads.iter().map(|c| thread_report(&c.plan));
        let handles = self.live.registry.all();
        Report {
            elapsed: clock::monotonic().saturating_sub(self.start),
            threads: threads.collect(),
            handles: handles
                .iter()
                .map(|(w, h)| handle_report(w, h, &self.stop))
                .collect(),
            #[cfg(feature = "texts")]
            rounds: self.rounds.iter().map(round_stats::report).collect(),
            dispatcher: DispatcherReport {
                rounds: self.counters.rounds.get(),
                samples: self.counters.samples.get(),
                failures: self.counters.failures.get(),
            },
            enforcers: self.enforcers().map(|e| e.stats()).collect(),
            fallbacks: self.fallbacks.clone(),
            admission: self.admission.report.clone(),
            stuck: self.stuck.clone(),
        }
    }

    /// The counters of one handle. Does not allocate.
    #[must_use]
    pub fn stats(&self, id: &str) -> Option<HandleStats> {
        let (_, handle) = self.live.registry.find(id)?;
        Some(handle_stats(&handle, &self.stop))
    }

    /// What has become of the rounds of a worker that begin by the clock
    /// ([`WorkerBuilder::every`](crate::WorkerBuilder::every)). Does not allocate.
    #[cfg(feature = "texts")]
    #[must_use]
    pub fn rounds(&self, worker: &str) -> Option<RoundStats> {
        let mut rounds = self.rounds.iter();
        let (_, counters) = rounds.find(|(name, _)| **name == *worker)?;
        Some(counters.snapshot())
    }

    /// What one worker, or the `dispatcher`, has used. Does not allocate.
    #[must_use]
    pub fn usage(&self, thread: &str) -> Option<Usage> {
        let threads = self.threads.iter().find(|c| &*c.plan.name == thread)?;
        Some(threads.plan.meter()?.usage())
    }

    /// The deployment file that describes the program as it runs: a start for one's own, which
    /// [`Executor::overlay`](crate::Executor::overlay) or `REPLENISH_OVERLAY` applies.
    #[must_use]
    pub fn template(&self) -> &str {
        &self.template
    }

    /// Discards every sample that waits for a worker and returns how many; they are counted as
    /// discarded. Samples still in the middleware are not touched.
    pub fn discard_waiting(&self) -> u64 {
        let handles = self.live.registry.all();
        let handles = handles.iter();
        handles.map(|(_, h)| h.discard(false, &self.stop)).sum()
    }

    fn enforcers(&self) -> impl Iterator<Item = &Arc<Enforcer>> {
        self.enforcers.iter().filter_map(|(_, e)| e.as_ref())
    }

    /// Ends all threads, one way or the other. The stop has been requested.
    fn finish(&mut self) -> Report {
        if let Some(report) = &self.end {
            return report.clone();
        }
        let deadline = clock::monotonic().saturating_add(nanos(self.grace));
        for meter in self.threads.iter().filter_map(|c| c.plan.meter()) {
            meter.cancel();
        }
        let me = os::current_tid();
        let awaited = |c: &StartedThread| !c.plan.is_finished() && c.thread.tid() != me;
        while self.threads.iter().any(awaited) {
            if !self.owner.wait_until(deadline) && clock::monotonic() >= deadline {
                break;
            }
        }
        // Stuck ones first: one that spins at high priority would keep the others from ending.
        for c in self.threads.iter().filter(|c| !c.plan.is_finished()) {
            self.stuck.push(String::from(&*c.plan.name));
            if let Some(meter) = c.plan.meter() {
                meter.abandon();
            }
            os::set_priority(c.thread.tid(), SchedClass::Other).ok();
            let thread = &c.plan.name;
            self.events.emit(&Event::Stuck { thread });
        }
        let mut report = self.report();
        let patience = clock::monotonic().saturating_add(EPILOGUE);
        for c in self.threads.drain(..) {
            let name = &c.plan.name;
            if c.plan.is_finished() && c.thread.join_until(patience).is_err() {
                // Done, but something above it on its CPU keeps it from ending.
                self.stuck.push(String::from(&**name));
                self.events.emit(&Event::Stuck { thread: name });
            }
        }
        for enforcer in self.enforcers() {
            enforcer.stop();
        }
        if self.stuck.iter().any(|s| s == "dispatcher") {
            core::mem::forget(self.claim.take()); // it may still be in the middleware
        }
        self.claim = None;
        self.admission.place = None;
        report.stuck.clone_from(&self.stuck);
        self.end = Some(report.clone());
        report
    }
}

impl Drop for RunningExecutor {
    fn drop(&mut self) {
        if self.end.is_none() {
            self.stop.stop();
            self.finish();
        }
    }
}

impl fmt::Debug for RunningExecutor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RunningExecutor")
            .field("stop", &self.stop)
            .finish_non_exhaustive()
    }
}

/// The counters of one handle.
pub(crate) fn handle_stats(handle: &HandleState, stop: &StopHandle) -> HandleStats {
    let lost = handle.input.as_ref();
    let lost = lost.map_or(0, |(reader, _)| stop.middleware.lost(*reader));
    handle.counters.snapshot(handle.waiting(), lost)
}

pub(crate) fn handle_report(worker: &str, handle: &HandleState, stop: &StopHandle) -> HandleReport {
    let error = String::from(handle.last_error.lock().as_str());
    HandleReport {
        id: handle.id.clone(),
        worker: worker.into(),
        stats: handle_stats(handle, stop),
        latency: handle.latency.snapshot(),
        response: handle.response.snapshot(),
        last_error: Some(error).filter(|e| !e.is_empty()),
    }
}

fn thread_report(plan: &ThreadPlan) -> ThreadReport {
    let ready = match &*plan.ready.lock() {
        Some(Ok(ready)) => Some(ready.clone()),
        _ => None,
    };
    let meter = ready.as_ref().map(|r: &Ready| &r.meter);
    ThreadReport {
        name: String::from(&*plan.name),
        requested: text!("{}", plan.policy),
        granted: ready.as_ref().map_or("-".into(), |r| r.granted.clone()),
        cpu: plan.cpu,
        enforcement: meter.and_then(os::Meter::enforcement),
        usage: meter.map(os::Meter::usage).unwrap_or_default(),
        overruns: meter.map(os::Meter::overruns).unwrap_or_default(),
    }
}
