//! Starting an executor: plan, spawn, fall back where allowed, launch all or none.

use super::assembly::{Assembly, assemble};
use super::plan::{URGENT, check, plan, rank};
use super::planning;
use super::running::{Crew, Enforcers, RunningExecutor};
use super::threads::{Body, Funding, Launch, Seat};
use crate::error::Error;
use crate::event::Event;
use crate::executor::describe::builder::WorkerSpec;
use crate::executor::run::dispatcher::Dispatcher;
#[cfg(feature = "texts")]
use crate::executor::run::round_stats;
use crate::executor::run::worker::Worker;
use crate::executor::{Executor, Options, StopHandle};
use crate::platform::{Kept, kept};
use crate::sync::{Arc, AtomicBool, Mutex, Signal};
use crate::text::{Words, list, text};
use alloc::boxed::Box;
use alloc::vec::Vec;
use replenish_os::clock;
use replenish_os::{self as os, Enforcement, Enforcer, EnforcerConfig, Policy};

/// Stack size in bytes where none was given.
const STACK: usize = if cfg!(feature = "std") { 1 << 20 } else { 4096 };

#[inline(never)]
pub(crate) fn start(mut executor: Executor) -> Result<RunningExecutor, Error> {
    let template = kept(planning::prepare(&mut executor)?);
    let Executor {
        context,
        mut workers,
        stop,
        mut options,
    } = executor;
    check_names(&workers)?;
    for w in &workers {
        if w.entries.is_empty() && w.rules.capacity.is_none() {
            return Err(Error::IdleWorker(Words::from(&*w.request.name)));
        }
        check(&w.request)?;
        w.check_rules()?;
    }
    let mut admission = kept(planning::admit(&mut workers, &mut options)?);
    let priority = options.enforcer_priority;
    plan(&mut workers, &mut options.dispatcher, priority)?;
    let claim = context.claim().ok_or(Error::ContextBusy)?;

    let owner = Arc::new(Signal::new());
    stop.stop.join(Arc::clone(&owner));
    let mut starter = kept(Starter {
        options: &options,
        stop: &stop,
        owner: &owner,
        enforcers: Vec::new(),
        refused: Refused::default(),
    });
    if options.lock_memory {
        starter.lock_memory()?;
    }
    #[cfg(feature = "texts")]
    let beats = workers.iter();
    #[cfg(feature = "texts")]
    let beats = beats
        .filter_map(|w| round_stats::of(&w.request, &w.rules))
        .collect();
    let Assembly {
        dispatcher,
        workers,
        live,
    } = assemble(&context, workers, &stop, &options.events);
    let counters = Arc::clone(&dispatcher.counters);
    let seats = starter.seats(dispatcher, workers);
    starter.enforcers(&seats)?;
    let mut crew = Vec::with_capacity(seats.len());
    if let Err(e) = starter.launch(seats, &mut crew) {
        return Err(abort(&mut crew, e));
    }
    let fallbacks = starter.declare(admission.fallback.take());
    let enforcers = core::mem::take(&mut starter.enforcers);
    let start = clock::monotonic();
    crew.iter().for_each(|c| c.seat.launch(Launch::Go(start)));
    Ok(RunningExecutor {
        stop,
        owner,
        crew,
        enforcers,
        live,
        counters,
        fallbacks,
        stuck: Vec::new(),
        events: Arc::clone(&options.events),
        grace: options.stop_grace,
        claim: Some(claim),
        admission,
        #[cfg(feature = "texts")]
        beats,
        template,
        start,
        end: None,
    })
}

pub(crate) fn check_names(workers: &[Kept<WorkerSpec>]) -> Result<(), Error> {
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

fn abort(crew: &mut Vec<Crew>, error: Error) -> Error {
    for c in crew.iter() {
        c.seat.launch(Launch::Abort);
    }
    // Where they are not joined, they end by themselves: nothing holds them up.
    if cfg!(not(target_os = "none")) {
        crew.drain(..).for_each(Crew::join);
    }
    error
}

fn thread_error(seat: &Seat, reason: Words) -> Error {
    Error::Thread {
        name: Words::from(&*seat.name),
        reason,
    }
}

/// What starting needs to know, and what it has to admit.
struct Starter<'a> {
    options: &'a Options,
    stop: &'a StopHandle,
    owner: &'a Arc<Signal>,
    enforcers: Enforcers,
    refused: Refused,
}

/// What was asked for and is not in force.
#[derive(Default)]
struct Refused {
    memory: Option<Words>,
    /// Threads without their policy.
    policies: Vec<Words>,
    /// Threads whose budget has no enforcer.
    budgets: Vec<Words>,
    /// What the kernel said first, with what would grant it.
    why: Option<Words>,
}

impl Starter<'_> {
    /// The places of all threads: the dispatcher's, which rings the most urgent worker first, then the
    /// workers'.
    fn seats(&self, mut dispatcher: Dispatcher, workers: Vec<Kept<Box<Worker>>>) -> Vec<Arc<Seat>> {
        for urgency in (0..=URGENT).rev() {
            let those = workers.iter().filter(|w| rank(&w.spec.policy) == urgency);
            dispatcher.bells.extend(those.map(|w| Arc::clone(&w.bell)));
        }
        let mut seats = Vec::with_capacity(workers.len() + 1);
        seats.push(self.seat(Body::Dispatcher(kept(dispatcher))));
        for worker in workers {
            seats.push(self.seat(Body::Worker(worker)));
        }
        seats
    }

    #[inline(never)]
    fn seat(&self, body: Body) -> Arc<Seat> {
        let (name, policy, cpu, stack_size, bell) = match &body {
            Body::Dispatcher(_) => {
                let bell = Arc::new(Signal::new());
                let Options {
                    dispatcher: policy,
                    dispatcher_cpu: cpu,
                    ..
                } = self.options;
                let policy = policy.unwrap_or_default();
                ("dispatcher".into(), policy, *cpu, None, bell)
            }
            Body::Worker(worker) => {
                let (asked, bell) = (&worker.spec.request, worker.bell.signal());
                let (name, bell) = (Arc::clone(&asked.name), Arc::clone(bell));
                (name, worker.spec.policy, asked.cpu, asked.stack_size, bell)
            }
        };
        Arc::new(Seat {
            name,
            policy,
            cpu,
            stack_size: stack_size.unwrap_or(STACK),
            prefault: self.options.lock_memory,
            bell,
            owner: Arc::clone(self.owner),
            stop: self.stop.clone(),
            events: Arc::clone(&self.options.events),
            body: Mutex::new(Some(body)),
            budget: Mutex::new(None),
            ready: Mutex::new(None),
            launch: Mutex::new(None),
            finished: AtomicBool::new(false),
        })
    }

    /// Starts the threads, and waits until every one has what it needs; the first that has not is
    /// the error.
    fn launch(&mut self, seats: Vec<Arc<Seat>>, crew: &mut Vec<Crew>) -> Result<(), Error> {
        for seat in seats {
            let thread = self.spawn(&seat)?;
            crew.push(Crew::new(seat, thread));
        }
        for c in crew {
            let seat = &c.seat;
            loop {
                match &*seat.ready.lock() {
                    Some(Ok(_)) => break,
                    Some(Err(reason)) => return Err(thread_error(seat, reason.clone())),
                    None if seat.is_finished() => {
                        return Err(thread_error(seat, "it ended while it was set up".into()));
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
    fn enforcers(&mut self, seats: &[Arc<Seat>]) -> Result<(), Error> {
        for seat in seats {
            let Policy::Sporadic(params) = &seat.policy else {
                continue;
            };
            let mut known = self.enforcers.iter();
            let known = match known.find(|(cpu, _)| *cpu == seat.cpu) {
                Some((_, known)) => known.clone(),
                None => {
                    let budgeted = |s: &Seat| matches!(s.policy, Policy::Sporadic(_));
                    let here = seats.iter();
                    let here = here.filter(|s| s.cpu == seat.cpu && budgeted(s));
                    let enforcer = self.enforcer(seat, here.count())?;
                    self.enforcers.push((seat.cpu, enforcer.clone()));
                    enforcer
                }
            };
            let Some(enforcer) = known.or_else(|| self.deferred(seat)) else {
                continue;
            };
            *seat.budget.lock() = Some(Funding {
                enforcer,
                params: *params,
                kind: self.options.server,
            });
        }
        Ok(())
    }

    /// For a thread whose enforcer was refused.
    #[cfg(not(target_os = "none"))]
    fn deferred(&mut self, seat: &Seat) -> Option<Arc<Enforcer>> {
        self.refused.budgets.push(Words::from(&*seat.name));
        Some(Enforcer::deferred())
    }

    /// No kernel without an operating system refuses one.
    #[cfg(target_os = "none")]
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    const fn deferred(&self, _: &Seat) -> Option<Arc<Enforcer>> {
        None
    }

    /// An enforcer for the CPU of `seat`; none if its priority is refused and need not be granted.
    fn enforcer(&mut self, seat: &Seat, capacity: usize) -> Result<Option<Arc<Enforcer>>, Error> {
        let defaults = match seat.cpu {
            Some(cpu) => EnforcerConfig::on_cpu(cpu),
            None => EnforcerConfig::unpinned(),
        };
        let config = EnforcerConfig {
            priority: self.options.enforcer_priority,
            capacity,
            switch_log: self.options.switch_log,
            ..defaults
        };
        match Enforcer::start(config) {
            Ok(enforcer) => Ok(Some(enforcer)),
            Err(e) => self.refuse(seat, &e).map(|()| None),
        }
    }

    /// Starts the thread, without its policy if that is not granted and need not be.
    fn spawn(&mut self, seat: &Arc<Seat>) -> Result<os::Thread<()>, Error> {
        let refused = match Seat::spawn(seat, seat.class()) {
            Ok(thread) => return Ok(thread),
            Err(e) => e,
        };
        self.refuse(seat, &refused)?;
        self.refused.policies.push(Words::from(&*seat.name));
        if let Some(funding) = &mut *seat.budget.lock()
            && funding.enforcer.enforcement() != Enforcement::Deferred
            && let Some(deferred) = self.deferred(seat)
        {
            funding.enforcer = deferred;
        }
        Seat::spawn(seat, Policy::Other).map_err(|e| thread_error(seat, text!("{e}")))
    }

    /// Takes note of a refusal that may be lived with; otherwise it is the error.
    fn refuse(&mut self, seat: &Seat, e: &os::SpawnError) -> Result<(), Error> {
        if !e.is_permission() {
            return Err(thread_error(seat, text!("{e}")));
        }
        if self.options.strict {
            return Err(Error::NotGranted {
                what: text!("{} for {:?}", seat.policy, &*seat.name),
                reason: text!("{e}"),
            });
        }
        self.refused.why.get_or_insert_with(|| text!("{e}"));
        Ok(())
    }

    /// Says once what is not in force.
    fn declare(&mut self, unseen: Option<Words>) -> Vec<Words> {
        if cfg!(target_os = "none") {
            return Vec::new(); // nothing was refused
        }
        let refused = core::mem::take(&mut self.refused);
        let mut fallbacks: Vec<Words> = refused.memory.into_iter().chain(unseen).collect();
        if let Some(why) = refused.why {
            let mut parts = Vec::new();
            if !refused.policies.is_empty() {
                let who = list(&refused.policies, ", ");
                parts.push(text!("time-shared instead of real-time: {who}"));
            }
            if !refused.budgets.is_empty() {
                let who = list(&refused.budgets, ", ");
                parts.push(text!("budgets held at callback boundaries only: {who}"));
            }
            fallbacks.push(text!("{}. {why}", list(&parts, "; ")));
        }
        for message in &fallbacks {
            self.options.events.emit(&Event::Fallback { message });
        }
        fallbacks
    }
}
