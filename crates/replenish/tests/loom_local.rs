//! Every interleaving of an executor without threads, which decides to sleep, with others who bring it
//! something to do: a message, a trigger, a timer's start, a stop. Nothing is lost, and nothing is
//! slept over.
//!
//! ```text
//!   real: executor/{local, assembly, dispatcher, worker, run_queue, doorbell, guard, timer, stop}.rs,
//!         fixed.rs in the place of what changes handles, handoff/, middleware/interest.rs
//!   stubs below: what they name besides
//! ```
//!
//! `RUSTFLAGS="--cfg loom" cargo test -p replenish --release --test "loom_*"`
#![cfg(loom)]
#![allow(clippy::unwrap_used, reason = "a model may panic")]
#![allow(
    dead_code,
    unused_imports,
    unused_macros,
    unreachable_pub,
    reason = "models use a part of what they include"
)]

extern crate alloc;
extern crate self as replenish_os; // the stubs of it are at the end

#[path = "../src/executor/start/assembly.rs"]
mod assembly;
#[path = "../src/executor/run/dispatcher.rs"]
mod dispatcher;
#[path = "../src/executor/wake/doorbell.rs"]
mod doorbell;
#[path = "../src/executor/change/fixed.rs"]
mod fixed;
#[path = "../src/executor/handles/guard.rs"]
mod guard;
#[path = "../src/middleware/interest.rs"]
mod interest;
#[path = "../src/executor/wake/lazy_now.rs"]
mod lazy_now;
#[path = "../src/executor/start/local.rs"]
mod local;
#[path = "../src/executor/run/routes.rs"]
mod routes;
#[path = "../src/executor/wake/run_queue.rs"]
mod run_queue;
#[path = "../src/executor/wake/schedule.rs"]
mod schedule;
#[path = "../src/executor/wake/stop.rs"]
mod stop;
#[path = "common/loom_dispatch.rs"]
mod stubs;
#[path = "../src/executor/handles/timer.rs"]
mod timer;
#[path = "../src/executor/run/worker.rs"]
mod worker;

use builder::WorkerSpec;
use callback::CallbackContext;
use entry::HandleEntry;
use fixed::{self as desk, self as mailbox};
use guard::{Guard, GuardCondition};
use handle::{Env, Handle, HandleState, Taken};
use handle_stubs::platform;
use handoff::{Inbox, Keep, Slot, Stop};
use lazy_now::LazyNow;
use local::{LocalExecutor, SpinEnd};
use loom::thread;
use middleware::{Fake, Middleware, ReaderId};
use replenish_handoff::{self as handoff, sync};
use schedule::Every;
use std::time::Duration;
use stop::StopHandle;
use stubs::{clock, event, middleware, stats};
use sync::Arc;
use timer::{Timer, TimerHandle};

/// The rooms of the executor, as the included files name them.
mod executor {
    pub(crate) use crate::{Executor, Options, StopHandle};
    pub(crate) mod change {
        pub(crate) use crate::live;
    }
    pub(crate) mod describe {
        pub(crate) use crate::builder;
    }
    pub(crate) mod handles {
        pub(crate) use crate::{callback, entry, guard, handle, outbox, timer};
    }
    pub(crate) mod run {
        pub(crate) use crate::{
            accounting, desk, dispatcher, mailbox, round_stats, rounds, routes, rules, worker,
        };
    }
    pub(crate) mod start {
        pub(crate) use crate::{assembly, launch, local, plan, planning, report, running};
    }
    pub(crate) mod wake {
        pub(crate) use crate::{doorbell, lazy_now, run_queue, schedule, stop};
    }
}

type Nanos = u64;

/// When the executor starts.
const START: Nanos = 1;

/// One worker, without handles so far.
fn executor() -> Executor {
    clock::set(START);
    let middleware: std::sync::Arc<dyn Middleware> = std::sync::Arc::new(Fake::holding(&[]));
    Executor {
        context: context::Context,
        workers: vec![WorkerSpec::default()],
        stop: StopHandle {
            stop: Arc::new(Stop::new()),
            middleware: Arc::from_std(middleware),
        },
        options: Options::default(),
    }
}

impl Executor {
    fn add(&mut self, shared: &Arc<HandleState>, handle: impl Handle + 'static) {
        let entry = HandleEntry::new(Arc::clone(shared), Box::new(handle));
        self.workers[0].entries.push(entry);
    }

    /// A subscription to reader 0 that has room for one sample.
    fn subscribe(&mut self) -> Arc<HandleState> {
        let inbox = Arc::new(Inbox::new(1, 1, Keep::All));
        let shared = HandleState::new(Some((ReaderId(0), inbox)));
        self.add(&shared, Subscription(Arc::clone(&shared), None));
        shared
    }

    fn guard(&mut self, condition: &GuardCondition) -> Arc<HandleState> {
        let shared = HandleState::new(None);
        let nothing = |_: &CallbackContext<'_>| ();
        let guard = Guard::new(Arc::clone(&shared), condition.clone(), nothing);
        self.add(&shared, guard);
        shared
    }

    fn timer(&mut self, handle: &TimerHandle, every: Every) {
        let shared = HandleState::new(None);
        let nothing = |_: &CallbackContext<'_>| ();
        let timer = Timer::new(Arc::clone(&shared), every, Some(handle.control()), nothing);
        self.add(&shared, timer);
    }
}

/// Runs callbacks without any limit of time until so many have run.
fn spin(mut local: LocalExecutor, callbacks: u64) {
    let mut ran = 0;
    while ran < callbacks {
        let spun = local.spin_some(Duration::MAX);
        assert_eq!(spun.end, SpinEnd::Worked);
        ran += spun.callbacks;
    }
    assert_eq!(ran, callbacks);
}

#[test]
fn a_trigger_ends_the_wait_whenever_it_comes() {
    loom::model(|| {
        let mut executor = executor();
        let condition = GuardCondition::new();
        executor.guard(&condition);
        let trigger = thread::spawn(move || condition.trigger());
        spin(local::local(executor).unwrap(), 1);
        trigger.join().unwrap();
    });
}

#[test]
fn triggers_of_two_threads_are_all_counted() {
    loom::model(|| {
        let mut executor = executor();
        let conditions = [(); 2].map(|()| GuardCondition::new());
        let served = conditions.each_ref().map(|c| executor.guard(c));
        let triggers = conditions.map(|condition| thread::spawn(move || condition.trigger()));
        spin(local::local(executor).unwrap(), 2);
        assert_eq!(served.map(|s| s.counters.received.get()), [1, 1]);
        triggers.into_iter().for_each(|t| t.join().unwrap());
    });
}

/// The second message finds the inbox full: the reader leaves the interest set, and comes back.
#[test]
fn messages_are_taken_whenever_they_come_also_when_there_was_no_room() {
    loom::model(|| {
        let mut executor = executor();
        let subscription = executor.subscribe();
        let middleware = Arc::clone(&executor.stop.middleware);
        let publisher = thread::spawn(move || {
            middleware.publish(ReaderId(0), 1);
            middleware.publish(ReaderId(0), 2);
        });
        spin(local::local(executor).unwrap(), 2);
        assert_eq!(subscription.counters.received.get(), 2);
        assert_eq!(subscription.counters.dropped.get(), 0);
        publisher.join().unwrap();
    });
}

/// Nothing is due, so the executor sleeps without limit; the timer that is started meanwhile fires one
/// period after that.
#[test]
fn a_timer_that_is_started_while_it_falls_asleep_fires() {
    loom::model(|| {
        let mut executor = executor();
        let handle = TimerHandle::new();
        let once = Every::once(Duration::from_nanos(10)).not_started();
        executor.timer(&handle, once);
        let other = handle.clone();
        let starter = thread::spawn(move || other.start());
        spin(local::local(executor).unwrap(), 1);
        assert_eq!(clock::monotonic(), START + 10);
        starter.join().unwrap();
    });
}

#[test]
fn a_stop_ends_the_spin_whenever_it_comes() {
    loom::model(|| {
        let executor = executor();
        let stop = executor.stop.clone();
        let stopper = thread::spawn(move || stop.stop());
        let spun = local::local(executor).unwrap().spin();
        assert_eq!((spun.callbacks, spun.end), (0, SpinEnd::Stopped));
        stopper.join().unwrap();
    });
}

#[test]
fn a_stop_ends_the_spin_after_a_restart_as_well() {
    loom::model(|| {
        let executor = executor();
        let stop = executor.stop.clone();
        let mut local = local::local(executor).unwrap();
        stop.stop();
        assert_eq!(local.spin().end, SpinEnd::Stopped);
        local.restart();
        let stopper = thread::spawn(move || stop.stop());
        assert_eq!(local.spin().end, SpinEnd::Stopped);
        stopper.join().unwrap();
    });
}

/// Takes what comes, and asks for more as soon as there is room.
struct Subscription(Arc<HandleState>, Option<Slot>);

impl Handle for Subscription {
    fn begin(&mut self, _: Nanos, _: &doorbell::Line) {}
    fn is_ready(&mut self, _: &LazyNow) -> bool {
        self.0.inbox().waiting() > 0
    }
    fn take(&mut self, env: &Env<'_>) -> Option<Taken> {
        if self.0.inbox().pop(&mut self.1)? {
            env.stop.middleware.wake();
        }
        let due = clock::monotonic();
        Some(Taken {
            due,
            deadline: None,
        })
    }
    fn execute(&mut self, _: &Env<'_>, _: Nanos) {}
}

// What the included files name besides: without protocols of their own.

struct Executor {
    context: context::Context,
    workers: Vec<WorkerSpec>,
    stop: StopHandle,
    options: Options,
}

#[derive(Default)]
struct Options {
    events: Arc<event::Events>,
}

struct Account;
#[derive(Clone)]
struct Meter;

impl Account {
    fn unbudgeted() -> Self {
        Self
    }
    fn meter(&self) -> Meter {
        Meter
    }
    fn has_budget(&self) -> bool {
        true
    }
    fn callback_begin(&mut self) -> Result<(), ()> {
        Ok(())
    }
    fn callback_end(&mut self) {}
    fn block(&mut self) {}
    fn activate(&mut self, _: Nanos) {}
}

mod callback {
    use crate::handle::{Env, HandleState};
    pub(crate) use crate::handle_stubs::callback::CallbackResult;
    use core::marker::PhantomData;

    pub(crate) struct CallbackContext<'a> {
        pub(crate) skipped: u64,
        pub(crate) stub: PhantomData<&'a ()>,
    }

    impl<'a> CallbackContext<'a> {
        pub(crate) fn new(_: &Env<'a>, _: &HandleState, _: u64, _: u64) -> Self {
            Self {
                skipped: 0,
                stub: PhantomData,
            }
        }
    }
}

mod handle {
    use crate::doorbell::Line;
    use crate::lazy_now::LazyNow;
    use crate::run_queue::RunQueue;
    use crate::stop::StopHandle;
    pub(crate) use crate::stubs::handle::HandleState;
    use std::cell::RefCell;

    impl HandleState {
        pub(crate) fn inbox(&self) -> &crate::Inbox {
            &self.input.as_ref().unwrap().1
        }
    }

    pub(crate) struct Env<'a> {
        pub(crate) worker: &'a str,
        pub(crate) stop: &'a StopHandle,
        pub(crate) events: &'a crate::event::Events,
        pub(crate) meter: &'a crate::Meter,
        pub(crate) live: Option<&'a crate::Arc<crate::live::Live>>,
        pub(crate) outbox: Option<&'a RefCell<crate::outbox::Outbox>>,
    }

    pub(crate) struct Taken {
        pub(crate) due: u64,
        pub(crate) deadline: Option<Deadline>,
    }

    /// Nobody judges here.
    pub(crate) struct Deadline;

    impl Deadline {
        pub(crate) const fn of(_: u64) -> Self {
            Self
        }
    }

    pub(crate) trait Handle: Send {
        fn begin(&mut self, start: u64, line: &Line);
        fn is_ready(&mut self, now: &LazyNow) -> bool;
        fn next_release(&mut self) -> Option<u64> {
            None
        }
        fn note_release(&mut self, _position: usize, _agenda: &mut RunQueue) {}
        fn take(&mut self, env: &Env<'_>) -> Option<Taken>;
        fn execute(&mut self, env: &Env<'_>, started: u64);
    }
}

mod entry {
    use crate::handle::{Env, Handle, HandleState};
    use crate::lazy_now::LazyNow;
    use crate::sync::Arc;

    #[derive(Default)]
    pub(crate) struct HandleOptions {
        pub(crate) always: Option<&'static crate::rounds::Rounds>,
    }

    pub(crate) struct HandleEntry {
        pub(crate) shared: Arc<HandleState>,
        pub(crate) handle: Box<dyn Handle>,
        pub(crate) handling: HandleOptions,
        pub(crate) slot: usize,
        pub(crate) ready: bool,
        pub(crate) took: u64,
    }

    impl HandleEntry {
        pub(crate) fn new(shared: Arc<HandleState>, handle: Box<dyn Handle>) -> Self {
            Self {
                shared,
                handle,
                handling: HandleOptions::default(),
                slot: usize::MAX,
                ready: false,
                took: 0,
            }
        }
        pub(crate) fn is_live(&self) -> bool {
            true
        }
        pub(crate) fn look(&mut self, now: &LazyNow) -> bool {
            self.handle.is_ready(now)
        }
        pub(crate) fn run(&mut self, env: &Env<'_>, _: bool, _: bool) -> bool {
            let taken = self.handle.take(env);
            if taken.is_some() {
                self.handle.execute(env, crate::clock::monotonic());
            }
            taken.is_some()
        }
        pub(crate) fn snapshot(&mut self, _: &Env<'_>) {}
    }
}

mod builder {
    use crate::entry::HandleEntry;

    #[derive(Default)]
    pub(crate) struct WorkerSpec {
        pub(crate) request: crate::plan::Request,
        pub(crate) rules: crate::rules::Rules,
        pub(crate) entries: Vec<HandleEntry>,
    }

    impl WorkerSpec {
        pub(crate) fn order(&mut self, _: usize) {
            let numbered = self.entries.iter_mut().enumerate();
            numbered.for_each(|(slot, entry)| entry.slot = slot);
        }
        pub(crate) fn limit(&self) -> usize {
            self.entries.len()
        }
        pub(crate) fn numbers(&self) -> u64 {
            0
        }
        pub(crate) fn check_rules(&self) -> Result<(), crate::error::Error> {
            Ok(())
        }
    }
}

mod plan {
    pub(crate) struct Request {
        pub(crate) name: crate::Arc<str>,
        pub(crate) policy: Option<()>,
        pub(crate) budget: Option<()>,
        pub(crate) guarantee: Option<()>,
        pub(crate) cpu: Option<()>,
        pub(crate) stack_size: Option<()>,
    }

    impl Default for Request {
        fn default() -> Self {
            Self {
                name: crate::Arc::from_std("".into()),
                policy: None,
                budget: None,
                guarantee: None,
                cpu: None,
                stack_size: None,
            }
        }
    }

    impl Request {
        pub(crate) fn owner(&self) -> String {
            String::new()
        }
    }
}

mod planning {
    pub(crate) fn prepare(_: &mut crate::Executor) -> Result<(), crate::error::Error> {
        Ok(())
    }
}

mod launch {
    pub(crate) fn check_names(_: &[crate::WorkerSpec]) -> Result<(), crate::error::Error> {
        Ok(())
    }
}

mod context {
    #[derive(Clone)]
    pub(crate) struct Context;
    pub(crate) struct Claim;

    impl Context {
        pub(crate) fn claim(&self) -> Option<Claim> {
            Some(Claim)
        }
    }
}

mod error {
    #[derive(Debug)]
    pub(crate) enum Error {
        ContextBusy,
        Parameter,
    }

    impl Error {
        pub(crate) fn parameter<O>(_: O, _: &str, _: &dyn core::fmt::Display, _: &str) -> Self {
            Self::Parameter
        }
    }
}

mod live {
    pub(crate) use crate::fixed::{Live, Post, Registry};

    pub(crate) struct ExecutorHandle {
        pub(crate) live: crate::Arc<Live>,
    }
}

/// No worker here goes by other rules than the usual one.
mod rounds {
    use crate::worker::Worker;
    use crate::{Account, Nanos, accounting::CpuAccounting};
    use std::cell::RefCell;

    pub(crate) struct Rounds {
        pub(crate) outbox: fn(&crate::rules::Rules) -> Option<RefCell<crate::outbox::Outbox>>,
        pub(crate) begin: fn(&mut Worker, Nanos),
        pub(crate) want_all: fn(&Worker) -> bool,
        pub(crate) step: fn(&mut Worker, &mut Account, &CpuAccounting) -> bool,
        pub(crate) next_wake: fn(&mut Worker) -> Option<Nanos>,
        pub(crate) end: fn(&mut Worker),
    }
}

/// Nor by the clock.
mod round_stats {
    use crate::Arc;

    pub(crate) struct RoundStats;
    pub(crate) struct RoundCounters;
    pub(crate) type WorkerRounds = (Arc<str>, Arc<RoundCounters>);

    impl RoundCounters {
        pub(crate) fn snapshot(&self) -> RoundStats {
            RoundStats
        }
    }

    pub(crate) fn of(_: &crate::plan::Request, _: &crate::rules::Rules) -> Option<WorkerRounds> {
        None
    }
    pub(crate) fn report(_: &WorkerRounds) {}
}

mod rules {
    #[derive(Default)]
    pub(crate) struct Rules {
        pub(crate) batch: Option<u32>,
        pub(crate) barrier: Option<(usize, usize)>,
        pub(crate) rounds: Option<&'static crate::rounds::Rounds>,
    }

    impl Rules {
        pub(crate) fn takes_first(&self) -> bool {
            false
        }
    }
}

mod accounting {
    pub(crate) struct CpuAccounting {
        pub(crate) meter: crate::Meter,
    }

    impl CpuAccounting {
        pub(crate) fn new(meter: crate::Meter) -> Self {
            Self { meter }
        }
        pub(crate) fn settle<C>(&self, _: &C, _: u64) {}
    }
}

mod outbox {
    pub(crate) struct Outbox;

    impl Outbox {
        pub(crate) fn new(_: usize, _: usize) -> Self {
            Self
        }
    }
}

#[derive(Default)]
struct AdmissionReport;

mod report {
    pub(crate) struct Report {
        pub(crate) elapsed: u64,
        pub(crate) threads: Vec<()>,
        pub(crate) handles: Vec<()>,
        pub(crate) rounds: Vec<()>,
        pub(crate) dispatcher: DispatcherReport,
        pub(crate) enforcers: Vec<()>,
        pub(crate) fallbacks: Vec<()>,
        pub(crate) admission: crate::AdmissionReport,
        pub(crate) stuck: Vec<()>,
    }

    pub(crate) struct DispatcherReport {
        pub(crate) rounds: u64,
        pub(crate) samples: u64,
        pub(crate) failures: u64,
    }
}

mod running {
    use crate::handle::HandleState;
    use crate::stop::StopHandle;

    pub(crate) fn handle_stats(_: &HandleState, _: &StopHandle) -> crate::stats::HandleStats {
        crate::stats::HandleStats
    }
    pub(crate) fn handle_report(_: &str, _: &HandleState, _: &StopHandle) {}
}

#[path = "common/loom_handles.rs"]
mod handle_stubs;
