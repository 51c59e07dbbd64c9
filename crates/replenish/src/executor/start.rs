//! Starting an executor: plan, spawn, fall back where allowed, launch all or none.

use super::assembly::{Assembly, assemble};
use super::builder::WorkerSpec;
use super::plan::{Request, check, plan, rank};
use super::running::{Crew, RunningExecutor};
use super::threads::{Body, Funding, Launch, Seat};
use super::{Executor, Options, StopHandle, planning};
use crate::error::Error;
use crate::event::Event;
use crate::sync::{Arc, AtomicBool, Mutex, Signal};
use crate::text::{Words, list, text};
use alloc::vec::Vec;
use replenish_os::clock;
use replenish_os::{self as os, Enforcement, Enforcer, EnforcerConfig, Policy};

/// Stack size in bytes where none was given.
const STACK: usize = if cfg!(feature = "std") { 1 << 20 } else { 4096 };

#[inline(never)]
pub(crate) fn start(mut executor: Executor) -> Result<RunningExecutor, Error> {
    let template = planning::prepare(&mut executor)?;
    let Executor {
        context,
        mut workers,
        stop,
        mut options,
    } = executor;
    check_names(&workers)?;
    for w in &workers {
        if w.entries.is_empty() && w.rules.capacity.is_none() {
            return Err(Error::IdleWorker(w.request.name.as_str().into()));
        }
        check(&w.request)?;
    }
    let mut admission = planning::admit(&mut workers, &mut options)?;
    if let Some(error) = workers.iter().find_map(WorkerSpec::violation) {
        return Err(error);
    }
    let requests: Vec<&Request> = workers.iter().map(|w| &w.request).collect();
    let dispatcher = options.dispatcher.as_ref();
    let (policies, dispatcher) = plan(&requests, dispatcher, options.enforcer_priority)?;
    let claim = context.claim().ok_or(Error::ContextBusy)?;

    let owner = Arc::new(Signal::new());
    stop.stop.join(Arc::clone(&owner));
    let mut starter = Starter {
        options: &options,
        stop: &stop,
        owner: &owner,
        enforcers: Vec::new(),
        refused: Refused::default(),
    };
    if options.lock_memory {
        starter.lock_memory()?;
    }

    // Bells in the order in which workers are woken: highest priority first, then as described.
    let rank = |w: usize| policies.get(w).map_or(0, rank);
    let mut order: Vec<usize> = Vec::with_capacity(workers.len());
    for w in 0..workers.len() {
        let lower = order.iter().position(|other| rank(*other) < rank(w));
        order.insert(lower.unwrap_or(w), w);
    }
    let Assembly {
        dispatcher: dispatch,
        workers,
        live,
    } = assemble(&context, workers, &stop, &options.events, &order);
    let counters = Arc::clone(&dispatch.counters);
    let mut seats = Vec::with_capacity(workers.len() + 1);
    let request = Request {
        cpu: options.dispatcher_cpu,
        ..Request::default()
    };
    let bell = Arc::new(Signal::new());
    let body = Body::Dispatcher(dispatch);
    seats.push(starter.seat("dispatcher".into(), dispatcher, &request, bell, body));
    for (at, (worker, request)) in workers.into_iter().enumerate() {
        let policy = policies.get(at).copied().unwrap_or_default();
        let (name, signal) = (worker.name.clone(), worker.bell.signal().clone());
        let body = Body::Worker(worker);
        seats.push(starter.seat(name, policy, &request, signal, body));
    }
    starter.enforcers(&seats)?;
    let mut crew = Vec::with_capacity(seats.len());
    for seat in seats {
        match starter.spawn(&seat) {
            Ok(thread) => crew.push(Crew::new(seat, thread)),
            Err(e) => return Err(abort(&mut crew, e)),
        }
    }
    if let Err(e) = all_ready(&crew, &owner) {
        return Err(abort(&mut crew, e));
    }
    let fallbacks = starter.declare(admission.fallback.take());
    let enforcers = starter.enforcers.into_iter().filter_map(|(_, e)| e);
    let enforcers = enforcers.collect();
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
        template,
        start,
        end: None,
    })
}

pub(crate) fn check_names(workers: &[WorkerSpec]) -> Result<(), Error> {
    for (i, w) in workers.iter().enumerate() {
        let name = &w.request.name;
        let mut earlier = workers.iter().take(i);
        if name == "dispatcher" || earlier.any(|o| o.request.name == *name) {
            return Err(Error::DuplicateWorker(name.as_str().into()));
        }
    }
    Ok(())
}

/// Waits until every thread has what it needs; the first that has not is the error.
fn all_ready(crew: &[Crew], owner: &Signal) -> Result<(), Error> {
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
            owner.wait();
        }
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
    /// By CPU, `None` for threads that are not pinned; without one where it was refused.
    enforcers: Vec<(Option<usize>, Option<Arc<Enforcer>>)>,
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
    fn seat(
        &self,
        name: Arc<str>,
        policy: Policy,
        request: &Request,
        bell: Arc<Signal>,
        body: Body,
    ) -> Arc<Seat> {
        Arc::new(Seat {
            name,
            policy,
            cpu: request.cpu,
            stack_size: request.stack_size.unwrap_or(STACK),
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
