//! Starting an executor: plan, spawn, fall back where allowed, launch all or none.

use super::assembly::{Assembly, assemble};
use super::plan::{URGENT, check, plan, rank};
use super::planning;
use super::report::Report;
use super::running::{Enforcers, RunningExecutor, StartedThread};
use super::threads::{BudgetBinding, Launch, Role, ThreadPlan};
use crate::error::Error;
use crate::event::Event;
use crate::executor::describe::executor::{Executor, Options};
use crate::executor::run::dispatcher::Dispatcher;
use crate::executor::run::round_stats::WorkerRounds;
use crate::executor::run::state::{Worker, WorkerSpec};
use crate::executor::wake::stop::StopHandle;
use crate::platform::recorder::{self, Recording, ThreadFacts};
use crate::platform::{BARE, STD, Static, Text, join, make_static, text};
use crate::process::{Chains, Diagnostics, follow_clock, start_chains};
use crate::sync::{Arc, AtomicBool, Mutex, Notify};
use alloc::boxed::Box;
use alloc::vec::Vec;
use replenish_os::clock;
use replenish_os::{self as os, Enforcement, Enforcer, EnforcerConfig, Policy};

/// Stack size in bytes where none was given.
const STACK: usize = if STD { 1 << 20 } else { 4096 };

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
        mut options,
    } = executor;
    check_names(&workers)?;
    for w in &workers {
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
        refused: Refused::default(),
    });
    if options.lock_memory == Some(true) {
        starter.lock_memory()?;
    }
    let rounds = rounds_of(&workers);
    let chains = start_chains(&options.chains, &mut workers)?;
    let Assembly {
        dispatcher,
        workers,
        live,
    } = assemble(&context, workers, &stop, &options.events);
    let counters = Arc::clone(&dispatcher.counters);
    let plans = starter.plans(dispatcher, workers);
    let mut recording = record(&options, &plans, &chains)?;
    starter.enforcers(&plans)?;
    let (choice, events) = (&options.diagnostics, &options.events);
    let mut diagnostics = Diagnostics::start(&context, choice, &plans, &live, &chains, events);
    let mut threads = Vec::with_capacity(plans.len());
    if let Err(e) = starter.launch(plans, &mut threads) {
        return Err(abort(&mut threads, e));
    }
    if let Err(e) = planning::adopt(&mut admission, &options, &threads) {
        return Err(abort(&mut threads, e));
    }
    let unseen = [
        admission.fallback.take(),
        recording.fallback.take(),
        diagnostics.fallback.take(),
    ];
    let fallbacks = starter.declare(unseen);
    let enforcers = core::mem::take(&mut starter.enforcers);
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

fn abort(threads: &mut Vec<StartedThread>, error: Error) -> Error {
    for c in threads.iter() {
        c.plan.launch(Launch::Abort);
    }
    // On the board the threads are not joined: they end by themselves.
    if !BARE {
        threads.drain(..).for_each(StartedThread::join);
    }
    error
}

fn thread_error(plan: &ThreadPlan, reason: Text) -> Error {
    Error::Thread {
        name: Text::from(&*plan.name),
        reason,
    }
}

/// The inputs of the start, and the requests that it could not fulfil.
struct Starter<'a> {
    options: &'a Options,
    stop: &'a StopHandle,
    owner: &'a Arc<Notify>,
    enforcers: Enforcers,
    refused: Refused,
}

/// Requests that are not in force.
#[derive(Default)]
struct Refused {
    memory: Option<Text>,
    /// Threads without their policy.
    policies: Vec<Text>,
    /// Threads whose budget has no enforcer.
    budgets: Vec<Text>,
    /// Threads of which the kernel does not record when they block.
    records: Vec<Text>,
    /// Reason of the first thread that is not recorded.
    unrecorded: Option<Text>,
    /// The fallback of enforcers without a watchdog, of the first.
    watchdog: Option<Text>,
    /// The kernel's first refusal, with the way to have the request granted.
    why: Option<Text>,
}

impl Starter<'_> {
    /// The places of all threads: the dispatcher's, which rings the most urgent worker first, then
    /// the workers'.
    fn plans(
        &self,
        mut dispatcher: Dispatcher,
        workers: Vec<Static<Box<Worker>>>,
    ) -> Vec<Arc<ThreadPlan>> {
        for urgency in (0..=URGENT).rev() {
            let those = workers.iter().filter(|w| rank(&w.spec.policy) == urgency);
            dispatcher.bells.extend(those.map(|w| Arc::clone(&w.bell)));
        }
        let mut plans = Vec::with_capacity(workers.len() + 1);
        plans.push(self.plan(Role::Dispatcher(make_static(dispatcher))));
        for worker in workers {
            plans.push(self.plan(Role::Worker(worker)));
        }
        plans
    }

    #[inline(never)]
    fn plan(&self, role: Role) -> Arc<ThreadPlan> {
        let (name, policy, cpu, stack_size, bell) = match &role {
            Role::Dispatcher(_) => {
                let bell = Arc::new(Notify::new());
                let Options {
                    dispatcher: policy,
                    dispatcher_cpu: cpu,
                    ..
                } = self.options;
                let policy = policy.unwrap_or_default();
                ("dispatcher".into(), policy, *cpu, None, bell)
            }
            Role::Worker(worker) => {
                let (asked, bell) = (&worker.spec.request, worker.bell.notify());
                let (name, bell) = (Arc::clone(&asked.name), Arc::clone(bell));
                (name, worker.spec.policy, asked.cpu, asked.stack_size, bell)
            }
        };
        Arc::new(ThreadPlan {
            name,
            policy,
            cpu,
            stack_size: stack_size.unwrap_or(STACK),
            prefault: self.options.lock_memory == Some(true),
            bell,
            owner: Arc::clone(self.owner),
            stop: self.stop.clone(),
            events: Arc::clone(&self.options.events),
            role: Mutex::new(Some(role)),
            budget: Mutex::new(None),
            ready: Mutex::new(None),
            launch: Mutex::new(None),
            finished: AtomicBool::new(false),
            slot: recorder::ThreadSlot::default(),
        })
    }

    /// Starts the threads, and waits until every one has what it needs; the first that has not is
    /// the error.
    fn launch(
        &mut self,
        plans: Vec<Arc<ThreadPlan>>,
        threads: &mut Vec<StartedThread>,
    ) -> Result<(), Error> {
        for plan in plans {
            let thread = self.spawn(&plan)?;
            threads.push(StartedThread::new(plan, thread));
        }
        for c in threads {
            let plan = &c.plan;
            loop {
                match &*plan.ready.lock() {
                    Some(Ok(ready)) => {
                        self.records(plan, &ready.meter)?;
                        break;
                    }
                    Some(Err(reason)) => return Err(thread_error(plan, reason.clone())),
                    None if plan.is_finished() => {
                        return Err(thread_error(plan, "it ended while it was set up".into()));
                    }
                    None => {}
                }
                self.owner.wait();
            }
        }
        Ok(())
    }

    fn lock_memory(&mut self) -> Result<(), Error> {
        match os::memory::lock_all() {
            Err(e) if self.options.strict => Err(Error::NotGranted {
                what: "locked memory".into(),
                reason: text!("{e}"),
            }),
            Err(e) => {
                self.refused.memory = Some(text!("memory is not locked: {e}"));
                Ok(())
            }
            Ok(()) => Ok(()),
        }
    }

    /// Starts one enforcer per CPU with budgets and tells every budgeted thread its own.
    #[inline(never)]
    fn enforcers(&mut self, plans: &[Arc<ThreadPlan>]) -> Result<(), Error> {
        for plan in plans {
            let Policy::Sporadic(params) = &plan.policy else {
                continue;
            };
            let mut known = self.enforcers.iter();
            let known = match known.find(|(cpu, _)| *cpu == plan.cpu) {
                Some((_, known)) => known.clone(),
                None => {
                    let budgeted = |s: &ThreadPlan| matches!(s.policy, Policy::Sporadic(_));
                    let here = plans.iter();
                    let here = here.filter(|s| s.cpu == plan.cpu && budgeted(s));
                    let enforcer = self.enforcer(plan, here.count())?;
                    self.enforcers.push((plan.cpu, enforcer.clone()));
                    enforcer
                }
            };
            let Some(enforcer) = known.or_else(|| self.deferred(plan)) else {
                continue;
            };
            *plan.budget.lock() = Some(BudgetBinding {
                enforcer,
                params: *params,
                kind: self.options.server,
            });
        }
        Ok(())
    }

    /// The enforcer of a thread whose own was refused: it defers callbacks.
    #[cfg(not(target_os = "none"))]
    fn deferred(&mut self, plan: &ThreadPlan) -> Option<Arc<Enforcer>> {
        self.refused.budgets.push(Text::from(&*plan.name));
        Some(Enforcer::deferred())
    }

    /// Without an operating system no enforcer is refused.
    #[cfg(target_os = "none")]
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    const fn deferred(&self, _: &ThreadPlan) -> Option<Arc<Enforcer>> {
        None
    }

    /// An enforcer for the CPU of `plan`; none if its priority is refused and need not be granted.
    fn enforcer(
        &mut self,
        plan: &ThreadPlan,
        capacity: usize,
    ) -> Result<Option<Arc<Enforcer>>, Error> {
        let defaults = match plan.cpu {
            Some(cpu) => EnforcerConfig::on_cpu(cpu),
            None => EnforcerConfig::unpinned(),
        };
        let config = EnforcerConfig {
            priority: self.options.enforcer_priority,
            capacity,
            switch_log: self.options.switch_log,
            keep_memory: self.options.lock_memory.is_none(),
            ..defaults
        };
        match Enforcer::start(config) {
            Ok(enforcer) => {
                if STD {
                    self.supervised(&enforcer)?;
                    if let Some(e) = enforcer.memory_refused() {
                        let late = || text!("budgets end late when memory runs short: {e}");
                        self.refused.memory.get_or_insert_with(late);
                    }
                    let events = Arc::clone(&self.options.events);
                    enforcer.on_fault(move |fault| {
                        let message = &*text!("{fault}");
                        events.emit(&Event::Fallback { message });
                    });
                }
                Ok(Some(enforcer))
            }
            Err(e) => self.refuse(plan, &e).map(|()| None),
        }
    }

    /// Takes note of an enforcer without a watchdog.
    fn supervised(&mut self, enforcer: &Enforcer) -> Result<(), Error> {
        let Some(e) = enforcer.watchdog_refused() else {
            return Ok(());
        };
        if self.options.strict {
            return Err(Error::NotGranted {
                what: "a watchdog for the enforcer".into(),
                reason: text!("{e}"),
            });
        }
        let unwatched = || text!("nobody notices if an enforcer fails: its watchdog: {e}");
        self.refused.watchdog.get_or_insert_with(unwatched);
        Ok(())
    }

    /// Starts the thread, without its policy if that is not granted and need not be.
    fn spawn(&mut self, plan: &Arc<ThreadPlan>) -> Result<os::Thread<()>, Error> {
        let refused = match ThreadPlan::spawn(plan, plan.class()) {
            Ok(thread) => return Ok(thread),
            Err(e) => e,
        };
        self.refuse(plan, &refused)?;
        self.refused.policies.push(Text::from(&*plan.name));
        if let Some(binding) = &mut *plan.budget.lock()
            && binding.enforcer.enforcement() != Enforcement::Deferred
            && let Some(deferred) = self.deferred(plan)
        {
            binding.enforcer = deferred;
        }
        ThreadPlan::spawn(plan, Policy::Other).map_err(|e| thread_error(plan, text!("{e}")))
    }

    /// Takes note of a refusal that may be lived with; otherwise it is the error.
    fn refuse(&mut self, plan: &ThreadPlan, e: &os::SpawnError) -> Result<(), Error> {
        if !e.is_permission() {
            return Err(thread_error(plan, text!("{e}")));
        }
        if self.options.strict {
            return Err(Error::NotGranted {
                what: text!("{} for {:?}", plan.policy, &*plan.name),
                reason: text!("{e}"),
            });
        }
        self.refused.why.get_or_insert_with(|| text!("{e}"));
        Ok(())
    }

    /// Takes note of a budgeted thread without the kernel's records of its blocking.
    fn records(&mut self, plan: &ThreadPlan, meter: &os::Meter) -> Result<(), Error> {
        if !STD {
            return Ok(()); // small kernels' hooks see every switch
        }
        let Some(e) = meter.records_refused() else {
            return Ok(());
        };
        let reason = text!(
            "context-switch records: {e}. They need kernel.perf_event_paranoid of 2 at most, a \
             descriptor each (ulimit -n), and locked memory (kernel.perf_event_mlock_kb, ulimit -l)"
        );
        if self.options.strict {
            return Err(Error::NotGranted {
                what: text!("exact account of blocking for {:?}", &*plan.name),
                reason,
            });
        }
        self.refused.records.push(Text::from(&*plan.name));
        self.refused.unrecorded.get_or_insert(reason);
        Ok(())
    }

    /// Says once what is not in force.
    fn declare(&mut self, unseen: [Option<Text>; 3]) -> Vec<Text> {
        if BARE {
            return Vec::new(); // nothing was refused
        }
        let refused = core::mem::take(&mut self.refused);
        let mut fallbacks: Vec<Text> = {
            let unseen = unseen.into_iter().flatten();
            let missing = refused.memory.into_iter().chain(refused.watchdog);
            missing.chain(unseen).collect()
        };
        if let Some(why) = refused.why {
            let mut parts = Vec::new();
            if !refused.policies.is_empty() {
                let who = join(&refused.policies, ", ");
                parts.push(text!("time-shared instead of real-time: {who}"));
            }
            if !refused.budgets.is_empty() {
                let who = join(&refused.budgets, ", ");
                parts.push(text!("budgets held at callback boundaries only: {who}"));
            }
            fallbacks.push(text!("{}. {why}", join(&parts, "; ")));
        }
        if let Some(why) = refused.unrecorded {
            let who = join(&refused.records, ", ");
            fallbacks.push(text!(
                "budgets come back late if callbacks block or are preempted: {who}. {why}"
            ));
        }
        for message in &fallbacks {
            self.options.events.emit(&Event::Fallback { message });
        }
        fallbacks
    }
}
