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
use crate::executor::change::live::Live;
use crate::executor::describe::planning::Admission;
use crate::executor::run::dispatcher::DispatcherCounters;
use crate::executor::run::round_stats::{RoundStats, WorkerRounds};
use crate::executor::wake::schedule::nanos;
use crate::executor::wake::stop::StopHandle;
use crate::middleware::Middleware;
use crate::platform::recorder::Recording;
use crate::platform::{Static, Text, text};
use crate::process::{Chains, Diagnostics};
use crate::stats::HandleStats;
use crate::sync::{Arc, Notify};
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use core::time::Duration;
use replenish_os::clock;
use replenish_os::{self as os, Enforcer, Thread, Tid, Usage};

/// Time in nanoseconds that threads have to end after their last work, whatever the grace.
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

    pub(crate) fn tid(&self) -> Tid {
        self.thread.tid()
    }

    /// Waits for the end of a thread that has finished its work; its panics are events already.
    pub(crate) fn join(self) {
        self.thread.join().ok();
    }
}

/// Enforcers by CPU, `None` for threads that are not pinned; without an enforcer where it was
/// refused.
pub(crate) type Enforcers = Vec<(Option<usize>, Option<Arc<Enforcer>>)>;

/// An executor that runs. Dropping it stops it.
#[must_use = "dropping it stops the executor"]
pub struct RunningExecutor {
    pub(crate) stop: StopHandle,
    pub(crate) middleware: Arc<dyn Middleware>,
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
    pub(crate) rounds: Vec<WorkerRounds>,
    pub(crate) chains: Chains,
    pub(crate) template: Static<String>,
    pub(crate) start: Nanos,
    pub(crate) recording: Recording,
    pub(crate) diagnostics: Diagnostics,
    pub(crate) end: Option<Report>,
}

impl RunningExecutor {
    /// Stops this executor from anywhere.
    #[must_use]
    pub fn stop_handle(&self) -> StopHandle {
        self.stop.clone()
    }

    /// Stops, joins and reports: within the grace period plus a few milliseconds, whatever the
    /// callbacks do. The executor's subscriptions and services are gone then, and messages that
    /// waited for them are back with their publishers; a client goes with its
    /// [`Client`](crate::Client) at the latest.
    ///
    /// In a callback of this executor it waits for all threads but that of the callback, which is
    /// reported as stuck: [`StopHandle`] is for callbacks.
    pub fn stop(mut self) -> Report {
        self.stop.stop();
        self.finish()
    }

    /// Blocks until the executor is stopped, then joins and reports.
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
                .map(|(w, h)| HandleReport::of(w, h, &*self.middleware))
                .collect(),
            rounds: self.rounds.iter().map(WorkerRounds::report).collect(),
            dispatcher: DispatcherReport::of(&self.counters),
            enforcers: self.enforcers().map(|e| e.stats()).collect(),
            fallbacks: self.fallbacks.clone(),
            chains: self.chains.report(),
            admission: self.admission.report(),
            stuck: self.stuck.clone(),
        }
    }

    /// The counters of one handle; `None` if there is no such id. Does not allocate.
    #[must_use]
    pub fn stats(&self, id: &str) -> Option<HandleStats> {
        let (_, handle) = self.live.registry.find(id)?;
        Some(handle.stats(&*self.middleware))
    }

    /// The rounds of a worker that begin by the clock
    /// ([`WorkerBuilder::every`](crate::WorkerBuilder::every)). Does not allocate.
    #[must_use]
    pub fn rounds(&self, worker: &str) -> Option<RoundStats> {
        self.rounds.iter().find_map(|r| r.stats_of(worker))
    }

    /// The usage of one worker, or of the `dispatcher`; `None` if there is no such name. Does not
    /// allocate.
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
        handles
            .map(|(_, h)| h.discard(false, &*self.middleware))
            .sum()
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
        let awaited = |c: &StartedThread| !c.plan.is_finished() && c.tid() != me;
        while self.threads.iter().any(awaited) {
            if !self.owner.wait_until(deadline) && clock::monotonic() >= deadline {
                break;
            }
        }
        // Stuck ones first: one that spins at high priority would keep the others from ending.
        let (stuck, events) = (&mut self.stuck, &self.events);
        for c in self.threads.iter().filter(|c| !c.plan.is_finished()) {
            leave_behind(&c.plan, &c.thread, stuck, events);
        }
        self.diagnostics.end();
        let mut report = self.report();
        // On a machine that others load a thread may end later than that, and within the grace.
        let patience = deadline.max(clock::monotonic().saturating_add(EPILOGUE));
        for StartedThread { plan, thread } in self.threads.drain(..) {
            if plan.is_finished()
                && let Err(thread) = thread.join_until(patience)
            {
                // Done, but something above it on its CPU keeps it from ending, or the thread drops
                // what callbacks have left in its thread locals.
                leave_behind(&plan, &thread, &mut self.stuck, &self.events);
            }
        }
        for enforcer in self.enforcers() {
            enforcer.stop();
        }
        let is_dispatched = self.stuck.iter().any(|s| s == "dispatcher");
        if is_dispatched {
            core::mem::forget(self.claim.take()); // it may still be in the middleware
        }
        self.live.end(is_dispatched);
        self.claim = None;
        self.admission.end();
        self.recording.end();
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

/// Gives up waiting for the thread; takes its budget and its priority.
fn leave_behind(plan: &ThreadPlan, thread: &Thread<()>, stuck: &mut Vec<String>, events: &Events) {
    let name = &*plan.name;
    stuck.push(String::from(name));
    if let Some(meter) = plan.meter() {
        meter.abandon();
    }
    thread.lower();
    events.emit(&Event::Stuck { thread: name });
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
