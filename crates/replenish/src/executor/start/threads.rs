//! The threads of an executor: their start, their launch, and their end.
//!
//! ```text
//!   starter                                 thread
//!   spawn ────────────────────────────────► enroll with the enforcer
//!   wait until all are ready ◄── owner bell ── ready (or why not)
//!   launch: Go(start) or Abort ── own bell ──► role … end
//!   finish: wait until all ended ◄ owner bell ─ finished
//! ```
//!
//! So either every thread of an executor runs with what was granted to it, or none has run at all.

use crate::Nanos;
use crate::event::{Event, Events};
use crate::executor::run::dispatcher::Dispatcher;
use crate::executor::run::state::Worker;
use crate::executor::wake::stop::StopHandle;
use crate::platform::{self, Static, TEXTS, Text, recorder, text};
use crate::sync::{Arc, AtomicBool, Mutex, Notify, Ordering};
use alloc::boxed::Box;
use replenish_os::{self as os, Account, Enforcer, Meter, Params, Policy, Thread};
use sporadic::Kind;

/// The work of a thread between launch and stop.
pub(crate) enum Role {
    Dispatcher(Static<Dispatcher>),
    Worker(Static<Box<Worker>>),
}

impl Role {
    fn run(self, account: &mut Account, start: Nanos) {
        match self {
            Self::Dispatcher(mut dispatcher) => dispatcher.run(account),
            Self::Worker(mut worker) => worker.run(account, start),
        }
    }
}

/// The description of one thread of this executor.
pub(crate) struct ThreadPlan {
    pub(crate) name: Arc<str>,
    pub(crate) policy: Policy,
    pub(crate) cpu: Option<usize>,
    pub(crate) stack_size: usize,
    /// Touch the stack before the first callback.
    pub(crate) prefault: bool,
    pub(crate) bell: Arc<Notify>,
    pub(crate) owner: Arc<Notify>,
    pub(crate) stop: StopHandle,
    pub(crate) events: Arc<Events>,
    pub(crate) role: Mutex<Option<Role>>,
    pub(crate) budget: Mutex<Option<BudgetBinding>>,
    pub(crate) ready: Mutex<Option<Result<Ready, Text>>>,
    pub(crate) launch: Mutex<Option<Launch>>,
    pub(crate) finished: AtomicBool,
    /// The thread's place in the flight recorder.
    pub(crate) slot: recorder::ThreadSlot,
}

/// The enforcer of a thread's budget.
#[derive(Clone)]
pub(crate) struct BudgetBinding {
    pub(crate) enforcer: Arc<Enforcer>,
    pub(crate) params: Params,
    pub(crate) kind: Kind,
}

/// A thread that waits for its launch.
#[derive(Clone)]
pub(crate) struct Ready {
    pub(crate) meter: Meter,
    pub(crate) granted: Text,
}

#[derive(Clone, Copy)]
pub(crate) enum Launch {
    /// Begin; timers count from this instant.
    Go(Nanos),
    /// Another thread could not start: end without having run.
    Abort,
}

impl ThreadPlan {
    /// Starts the thread under `policy`, which may be a fallback for the one asked for.
    pub(crate) fn spawn(plan: &Arc<Self>, policy: Policy) -> Result<Thread<()>, os::SpawnError> {
        let mut spec = os::ThreadSpec::new(&*plan.name)
            .policy(policy)
            .stack_size(plan.stack_size);
        if let Some(cpu) = plan.cpu {
            spec = spec.cpu(cpu);
        }
        let plan = Arc::clone(plan);
        os::spawn(spec, move || plan.main())
    }

    /// The policy the thread is created with: an enforcer makes it sporadic.
    pub(crate) fn class(&self) -> Policy {
        match &self.policy {
            Policy::Sporadic(params) => Policy::Fifo {
                priority: params.priority(),
            },
            other => *other,
        }
    }

    pub(crate) fn is_finished(&self) -> bool {
        self.finished.load(Ordering::Acquire)
    }

    pub(crate) fn launch(&self, launch: Launch) {
        *self.launch.lock() = Some(launch);
        self.bell.set();
    }

    pub(crate) fn meter(&self) -> Option<Meter> {
        match &*self.ready.lock() {
            Some(Ok(ready)) => Some(ready.meter.clone()),
            _ => None,
        }
    }

    fn main(&self) {
        let _finished = Finished(self);
        if self.prefault {
            // Without it callbacks meet page faults: slower, not wrong.
            os::memory::prefault_stack(self.stack_size).ok();
        }
        let enrolled = self.enroll();
        let (account, ready) = match enrolled {
            Ok((account, ready)) => {
                self.slot.install(&account, &ready.granted);
                (Some(account), Ok(ready))
            }
            Err(why) => (None, Err(why)),
        };
        *self.ready.lock() = Some(ready);
        self.owner.set();
        let start = loop {
            self.bell.wait();
            match *self.launch.lock() {
                Some(Launch::Go(start)) => break start,
                Some(Launch::Abort) => return,
                None => {}
            }
        };
        let role = self.role.lock().take();
        let (Some(mut account), Some(role)) = (account, role) else {
            return;
        };
        platform::prepare_end();
        // Callbacks are caught one by one in the worker: what arrives here is our own mistake, or
        // a middleware's, and must not leave the others running without it.
        let panicked = |_: &mut Account, _: &str| {
            self.stop.stop();
            let thread = &self.name;
            self.events.emit(&Event::ThreadPanicked { thread });
        };
        platform::guard(&mut account, |account| role.run(account, start), panicked);
        platform::end_with(account);
    }

    fn enroll(&self) -> Result<(Account, Ready), Text> {
        let account = match &*self.budget.lock() {
            None => Account::unbudgeted(),
            Some(f) => f
                .enforcer
                .enroll(&f.params, f.kind)
                .map_err(|e| text!("{e}"))?,
        };
        let meter = account.meter();
        let granted = granted(&meter);
        Ok((account, Ready { meter, granted }))
    }
}

/// The scheduling that the kernel granted, in words; the kernel is not asked in builds without
/// texts.
fn granted(meter: &Meter) -> Text {
    match TEXTS.then(|| os::granted(meter.tid())) {
        Some(Ok(granted)) => text!("{granted}"),
        Some(Err(e)) => text!("unknown: {e}"),
        None => text!("-"),
    }
}

struct Finished<'a>(&'a ThreadPlan);

impl Drop for Finished<'_> {
    fn drop(&mut self) {
        self.0.finished.store(true, Ordering::Release);
        self.0.owner.set();
    }
}
