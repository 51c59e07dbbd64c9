//! Chooses and starts an executor's threads and enforcers.

use super::plan::{URGENT, rank};
use super::refused::{Refused, thread_error};
use super::running::{Enforcers, StartedThread};
use super::threads::{BudgetBinding, Role, ThreadPlan};
use crate::error::Error;
use crate::event::Event;
use crate::executor::describe::executor::Options;
use crate::executor::run::dispatcher::Dispatcher;
use crate::executor::run::state::Worker;
use crate::executor::wake::stop::StopHandle;
use crate::platform::{STD, Static, Text, make_static, recorder, text};
use crate::sync::{Arc, AtomicBool, Mutex, Notify};
use alloc::boxed::Box;
use alloc::vec::Vec;
use replenish_os::{self as os, Enforcement, Enforcer, EnforcerConfig, Policy};

/// Stack size in bytes where none was given.
const STACK: usize = if STD { 1 << 20 } else { 4096 };

/// The inputs of the start, and the requests that it could not fulfil.
pub(super) struct Starter<'a> {
    pub(super) options: &'a Options,
    pub(super) stop: &'a StopHandle,
    pub(super) owner: &'a Arc<Notify>,
    pub(super) enforcers: Enforcers,
    pub(super) threads: Vec<StartedThread>,
    pub(super) refused: Refused,
}

impl Starter<'_> {
    /// The places of all threads: the dispatcher's, which rings the most urgent worker first, then
    /// the workers'.
    pub(super) fn plans(
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
    pub(super) fn launch(&mut self, plans: &[Arc<ThreadPlan>]) -> Result<(), Error> {
        self.threads.reserve_exact(plans.len());
        for plan in plans {
            let thread = self.spawn(plan)?;
            let thread = StartedThread::new(Arc::clone(plan), thread);
            self.threads.push(thread);
        }
        for c in &self.threads {
            let plan = &c.plan;
            loop {
                match &*plan.ready.lock() {
                    Some(Ok(ready)) => {
                        self.refused.records(plan, &ready.meter)?;
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

    /// Starts one enforcer per CPU with budgets and tells every budgeted thread its own.
    #[inline(never)]
    pub(super) fn enforcers(&mut self, plans: &[Arc<ThreadPlan>]) -> Result<(), Error> {
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
                    self.refused.supervised(&enforcer)?;
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
            Err(e) => self.refused.refuse(plan, &e).map(|()| None),
        }
    }

    /// Starts the thread, without its policy if that is not granted and need not be.
    fn spawn(&mut self, plan: &Arc<ThreadPlan>) -> Result<os::Thread<()>, Error> {
        let refused = match ThreadPlan::spawn(plan, plan.class()) {
            Ok(thread) => return Ok(thread),
            Err(e) => e,
        };
        self.refused.refuse(plan, &refused)?;
        self.refused.policies.push(Text::from(&*plan.name));
        if let Some(binding) = &mut *plan.budget.lock()
            && binding.enforcer.enforcement() != Enforcement::Deferred
            && let Some(deferred) = self.deferred(plan)
        {
            binding.enforcer = deferred;
        }
        ThreadPlan::spawn(plan, Policy::Other).map_err(|e| thread_error(plan, text!("{e}")))
    }
}
