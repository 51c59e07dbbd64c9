//! Starting an executor: plan, spawn, launch all threads or none.

use super::assembly::{Assembly, assemble};
use super::plan::{check, plan};
use super::planning;
use super::refused::Refused;
use super::report::Report;
use super::running::{RunningExecutor, StartedThread};
use super::starter::Starter;
use super::threads::{Launch, ThreadPlan};
use crate::error::Error;
use crate::executor::change::live::Live;
use crate::executor::describe::executor::{Executor, Options};
use crate::executor::run::round_stats::WorkerRounds;
use crate::executor::run::state::WorkerSpec;
use crate::platform::recorder::{Recording, ThreadFacts};
use crate::platform::{BARE, Static, Text, make_static};
use crate::process::{Chains, Diagnostics, follow_clock, start_chains};
use crate::sync::{Arc, Notify};
use alloc::vec::Vec;
use replenish_os::{Policy, clock};

impl Executor {
    /// Starts everything and blocks until the executor is stopped.
    ///
    /// # Errors
    /// As [`start`](Self::start).
    pub fn spin(self) -> Result<Report, Error> {
        Ok(self.start()?.wait())
    }

    /// Starts everything and returns: no callback has run before all threads have what was granted.
    ///
    /// # Errors
    /// [`Error::DuplicateWorker`], [`Error::IdleWorker`], [`Error::Name`] and
    /// [`Error::Parameter`] for what was described; [`Error::ContextBusy`];
    /// [`Error::Overlay`] for a deployment file; [`Error::NotAdmitted`] when a guarantee does not
    /// fit, or would break another program's;
    /// [`Error::Thread`] when a thread cannot be started; with [`strict`](Self::strict)
    /// [`Error::NotGranted`]. Nothing runs then.
    pub fn start(self) -> Result<RunningExecutor, Error> {
        start(self)
    }
}

#[inline(never)]
fn start(mut executor: Executor) -> Result<RunningExecutor, Error> {
    follow_clock(&mut executor)?;
    let template = make_static(planning::prepare(&mut executor)?);
    let Executor {
        context,
        mut workers,
        stop,
        options,
    } = executor;
    let mut options = make_static(options);
    check_names(&workers)?;
    for w in workers.iter() {
        if w.entries.is_empty() && w.rules.capacity.is_none() {
            return Err(Error::IdleWorker(Text::from(&*w.request.name)));
        }
        check(&w.request)?;
        w.check_rules()?;
    }
    let mut admission = make_static(planning::admit(&mut workers, &mut options)?);
    let priority = options.enforcer_priority;
    plan(&mut workers, &mut options.dispatcher, priority)?;
    let claim = context.claim(&stop).ok_or(Error::ContextBusy)?;

    let owner = Arc::new(Notify::new());
    stop.stop.join(Arc::clone(&owner));
    let mut starter = make_static(Starter {
        options: &options,
        stop: &stop,
        owner: &owner,
        enforcers: Vec::new(),
        threads: Vec::new(),
        refused: Refused {
            strict: options.strict,
            ..Refused::default()
        },
    });
    if options.lock_memory == Some(true) {
        starter.refused.lock_memory()?;
    }
    let rounds = rounds_of(&workers);
    let chains = start_chains(&options.chains, &mut workers)?;
    let Assembly {
        dispatcher,
        workers,
        live,
    } = assemble(&context, workers.begin(), &stop, &options.events);
    let failed = EndOnFailure(Some(Arc::clone(&live)));
    let counters = Arc::clone(&dispatcher.counters);
    let plans = make_static(starter.plans(dispatcher, workers));
    let mut recording = record(&options, &plans, &chains)?;
    starter.enforcers(&plans)?;
    let (choice, events) = (&options.diagnostics, &options.events);
    let mut diagnostics = Diagnostics::start(&context, choice, &plans, &live, &chains, events);
    let launched = starter.launch(&plans);
    let adopted =
        launched.and_then(|()| planning::adopt(&mut admission, &options, &starter.threads));
    if let Err(e) = adopted {
        abort(&mut starter.threads);
        return Err(e);
    }
    let unseen = [
        admission.fallback.take(),
        recording.fallback.take(),
        diagnostics.fallback.take(),
    ];
    let fallbacks = starter.refused.declare(unseen, &options.events);
    failed.disarm();
    let enforcers = core::mem::take(&mut starter.enforcers);
    let threads = core::mem::take(&mut starter.threads);
    let start = clock::monotonic();
    threads
        .iter()
        .for_each(|c| c.plan.launch(Launch::Go(start)));
    Ok(RunningExecutor {
        stop,
        middleware: context.share_middleware(),
        owner,
        threads,
        enforcers,
        live,
        counters,
        fallbacks,
        stuck: Vec::new(),
        events: Arc::clone(&options.events),
        grace: options.stop_grace,
        claim: Some(claim),
        admission,
        rounds,
        chains,
        template,
        start,
        recording,
        diagnostics,
        end: None,
    })
}

/// Takes the readers away where the start fails after all.
struct EndOnFailure(Option<Arc<Live>>);

impl EndOnFailure {
    fn disarm(mut self) {
        self.0 = None;
    }
}

impl Drop for EndOnFailure {
    fn drop(&mut self) {
        if let Some(live) = &self.0 {
            live.end(false); // no thread of it runs any more
        }
    }
}

/// Lays out the recording of these threads and chains.
fn record(
    options: &Options,
    plans: &[Arc<ThreadPlan>],
    chains: &Chains,
) -> Result<Recording, Error> {
    let facts = plans.iter().enumerate().map(|(n, plan)| ThreadFacts {
        slot: &plan.slot,
        name: &plan.name,
        dispatches: n == 0,
        cpu: plan.cpu,
        budget: match &plan.policy {
            Policy::Sporadic(params) => Some((params.budget(), params.period())),
            _ => None,
        },
    });
    let bytes = options.recorder.bytes;
    Recording::start(&options.recorder, facts, &chains.facts())
        .map_err(|why| Error::parameter("executor", "recorder", &bytes, why))
}

/// The counters of the rounds that begin by the clock.
pub(crate) fn rounds_of(workers: &[Static<WorkerSpec>]) -> Vec<WorkerRounds> {
    let workers = workers.iter().map(|worker| -> &WorkerSpec { worker });
    workers.filter_map(WorkerSpec::counted_rounds).collect()
}

pub(crate) fn check_names(workers: &[Static<WorkerSpec>]) -> Result<(), Error> {
    let mut rest = workers;
    while let Some((w, others)) = rest.split_last() {
        let name = &*w.request.name;
        if name == "dispatcher" || others.iter().any(|o| *o.request.name == *name) {
            return Err(Error::DuplicateWorker(name.into()));
        }
        rest = others;
    }
    Ok(())
}

fn abort(threads: &mut Vec<StartedThread>) {
    for c in threads.iter() {
        c.plan.launch(Launch::Abort);
    }
    // On the board the threads are not joined: they end by themselves.
    if !BARE {
        threads.drain(..).for_each(StartedThread::join);
    }
}
