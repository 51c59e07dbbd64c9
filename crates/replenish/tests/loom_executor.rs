//! Every interleaving of the executor's own protocols, over the real code: the dispatcher with its
//! interest set, the desk where routes change, the mailbox through which handles come and go.
//!
//! ```text
//!   real: executor/{dispatcher, desk, routes, mailbox}.rs, handoff/, middleware/interest.rs
//!   stubs below: what they name besides; no protocol of the executor's is among it
//! ```
//!
//! `RUSTFLAGS="--cfg loom" cargo test -p replenish --release --test "loom_*"`
#![cfg(loom)]
#![allow(clippy::unwrap_used, reason = "a model may panic")]
#![allow(
    dead_code,
    unused_imports,
    reason = "models use a part of what they include"
)]

extern crate alloc;
extern crate self as replenish_os; // the stubs of it are at the end

#[path = "../src/executor/run/desk.rs"]
mod desk;
#[path = "../src/executor/run/dispatcher.rs"]
mod dispatcher;
#[path = "../src/middleware/interest.rs"]
mod interest;
#[path = "../src/executor/run/mailbox.rs"]
mod mailbox;
#[path = "../src/executor/run/routes.rs"]
mod routes;
#[path = "common/loom_dispatch.rs"]
mod stubs;

use desk::Desk;
use dispatcher::{Dispatcher, DispatcherCounters};
use doorbell::{Doorbell, Line};
use entry::HandleEntry;
use handle::HandleState;
use handoff::{Inbox, Keep, SampleInfo, Stop};
use loom::thread;
use mailbox::{Declined, Mailbox, Order};
use middleware::{Fake, Interest, Middleware, ReaderId};
use replenish_handoff::{self as handoff, sync};
use routes::Route;
use stop::StopHandle;
use stubs::{clock, event, handle, middleware, stats};
use sync::{Arc, AtomicBool, Notify, Ordering};
use worker::Worker;

/// The rooms of the executor, as the included files name them.
mod executor {
    pub(crate) mod handles {
        pub(crate) use crate::{entry, handle};
    }
    pub(crate) mod run {
        pub(crate) use crate::{desk, dispatcher, mailbox, routes, worker};
    }
    pub(crate) mod wake {
        pub(crate) use crate::{doorbell, stop};
    }
}

type Nanos = u64;

fn reader(id: u16) -> ReaderId {
    ReaderId(id)
}

/// To a worker of one handle.
fn route_to(bell: &Arc<Doorbell>, shared: &Arc<HandleState>) -> Route {
    Route {
        shared: Arc::clone(shared),
        line: Line {
            bell: Arc::clone(bell),
            slot: 0,
        },
        hand: None,
    }
}

fn route(shared: &Arc<HandleState>) -> Route {
    route_to(&Arc::new(Doorbell::default()), shared)
}

fn post(used: usize, limit: usize) -> (Arc<Mailbox>, Arc<Doorbell>) {
    let bell = Arc::new(Doorbell::default());
    (Mailbox::new(used, limit, Arc::clone(&bell)), bell)
}

/// Reader 0 is full after its first sample and leaves the interest set. Reader 1, behind it, gets
/// what is its own meanwhile; reader 0 gets the rest as soon as there is room; the stop ends it.
#[test]
fn a_full_reader_leaves_the_interest_set_holds_up_nobody_and_comes_back() {
    loom::model(|| {
        let middleware = Arc::new(Fake::holding(&[(0, 1), (0, 2), (1, 3)]));
        let inboxes = [(); 2].map(|()| Arc::new(Inbox::new(1, 1, Keep::All)));
        let shared = [0, 1].map(|id| {
            let inbox = Arc::clone(&inboxes[usize::from(id)]);
            HandleState::new(Some((reader(id), inbox)))
        });
        let stop = StopHandle {
            stop: Arc::new(Stop::new()),
            middleware: Arc::clone(&middleware),
        };
        let bell = Arc::new(Doorbell::default());
        let mut dispatcher = Dispatcher {
            stop: stop.clone(),
            events: Arc::new(event::Events),
            counters: Arc::new(DispatcherCounters::default()),
            routes: shared.iter().map(|s| Some(route_to(&bell, s))).collect(),
            desk: Desk::new(),
            bells: vec![Arc::clone(&bell)],
        };
        let dispatcher = thread::spawn(move || dispatcher.run(&mut Account));
        while inboxes[1].waiting() == 0 {
            bell.wait();
        }
        let (mut got, mut hands) = (Vec::new(), [None, None]);
        while got.len() < 3 {
            let both = inboxes.iter().zip(&mut hands);
            let popped = both.filter_map(|(inbox, hand)| {
                if inbox.pop(hand)? {
                    middleware.wake();
                }
                Some(hand.as_ref()?.payload()[0])
            });
            let before = got.len();
            got.extend(popped);
            if got.len() == before {
                bell.wait();
            }
        }
        got.retain(|sample| *sample != 3);
        assert_eq!(got, [1, 2]);
        stop.stop.request();
        middleware.wake();
        dispatcher.join().unwrap();
    });
}

/// Two threads add routes while the dispatcher looks at the desk: it sees both before it sleeps.
#[test]
fn no_order_is_left_on_the_desk() {
    loom::model(|| {
        let desk = Desk::new();
        let middleware = Arc::new(Fake::holding(&[]));
        let threads: Vec<_> = [0, 1]
            .map(|id| {
                let (desk, middleware) = (Arc::clone(&desk), Arc::clone(&middleware));
                thread::spawn(move || {
                    let place = desk.keep().unwrap();
                    place.order(reader(id), Some(route(&HandleState::new(None))));
                    middleware.wake();
                })
            })
            .into();
        let mut routes = [None, None];
        let (mut interest, mut parked) = (Interest::empty(), Interest::empty());
        loop {
            desk.carry_out(&*middleware, &mut routes, &mut interest, &mut parked);
            if interest.len() == 2 {
                break;
            }
            middleware.wait(&Interest::empty(), None).unwrap();
        }
        assert!(routes.iter().all(Option::is_some));
        assert_eq!(middleware.deleted(), 0);
        threads.into_iter().for_each(|t| t.join().unwrap());
    });
}

/// A route is taken away: once the remover hears of it the dispatcher has let go, the reader is
/// deleted once, and what belonged to the route is freed on the remover's thread.
#[test]
fn a_route_that_goes_is_freed_by_the_one_who_asked() {
    loom::model(|| {
        let desk = Desk::new();
        let middleware = Arc::new(Fake::holding(&[]));
        let shared = HandleState::new(None);
        let mut routes = [Some(route(&shared))];
        let dispatcher = {
            let (desk, middleware) = (Arc::clone(&desk), Arc::clone(&middleware));
            thread::spawn(move || {
                let mut interest = Interest::empty();
                let mut parked = Interest::empty();
                interest.insert(reader(0));
                while !interest.is_empty() {
                    middleware.wait(&Interest::empty(), None).unwrap();
                    desk.carry_out(&*middleware, &mut routes, &mut interest, &mut parked);
                }
                assert!(routes[0].is_none());
            })
        };
        desk.keep().unwrap().order(reader(0), None);
        middleware.wake();
        while !shared.unrouted.load(Ordering::Acquire) {
            thread::yield_now();
        }
        desk.sweep();
        assert_eq!(
            Arc::strong_count(&shared),
            1,
            "the desk or the dispatcher has it"
        );
        assert_eq!(middleware.deleted(), 1);
        dispatcher.join().unwrap();
    });
}

/// The worker's loop as far as the mailbox goes; `visit` is its round. Ends when that says so.
fn work(mailbox: &Mailbox, bell: &Doorbell, worker: &mut Worker, visit: impl Fn(&Worker) -> bool) {
    mailbox.open();
    loop {
        mailbox.empty(worker);
        if visit(worker) {
            return;
        }
        bell.wait();
    }
}

/// Two threads add a handle each: the worker gets both before it sleeps for good.
#[test]
fn handles_of_two_threads_arrive() {
    loom::model(|| {
        let (mailbox, bell) = post(0, 2);
        let threads: Vec<_> = (0..2)
            .map(|_| {
                let mailbox = Arc::clone(&mailbox);
                thread::spawn(move || {
                    let place = mailbox.reserve().unwrap();
                    let entry = HandleEntry::new(&HandleState::new(None), place);
                    mailbox.send(Order::Add(entry)).unwrap();
                })
            })
            .collect();
        let mut worker = Worker::default();
        work(&mailbox, &bell, &mut worker, |w| w.spec.entries.len() == 2);
        assert!(matches!(
            mailbox.reserve(),
            Err(Declined::Full { limit: 2 })
        ));
        threads.into_iter().for_each(|t| t.join().unwrap());
    });
}

/// A removal that has waited: no callback starts any more, the entry is freed on the remover's
/// thread, and its place is free again.
#[test]
fn after_a_removal_no_callback_starts_and_the_place_is_free() {
    loom::model(|| {
        let (mailbox, bell) = post(0, 1);
        let shared = HandleState::new(None);
        let place = mailbox.reserve().unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let freed = Arc::new(AtomicBool::new(false));
        let mut worker = Worker::default();
        worker.spec.entries.push(HandleEntry::new(&shared, place));
        let running = {
            let (mailbox, bell) = (Arc::clone(&mailbox), Arc::clone(&bell));
            let (stop, freed) = (Arc::clone(&stop), Arc::clone(&freed));
            thread::spawn(move || {
                work(&mailbox, &bell, &mut worker, |worker| {
                    for entry in &worker.spec.entries {
                        if !entry.shared.removed.load(Ordering::Acquire) {
                            assert!(!freed.load(Ordering::Acquire), "a callback started");
                        }
                    }
                    stop.load(Ordering::Acquire)
                });
                worker.spec.entries.len()
            })
        };
        assert!(!shared.removed.swap(true, Ordering::AcqRel));
        mailbox.send(Order::Remove(Arc::clone(&shared))).unwrap();
        shared.gone.wait();
        freed.store(true, Ordering::Release);
        mailbox.sweep();
        mailbox.reserve().unwrap();
        stop.store(true, Ordering::Release);
        bell.call();
        assert_eq!(running.join().unwrap(), 0);
        assert_eq!(Arc::strong_count(&shared), 1);
    });
}

/// The worker ends while somebody removes a handle: the removal is declined or answered.
#[test]
fn nobody_waits_for_a_worker_that_has_ended() {
    loom::model(|| {
        let (mailbox, bell) = post(0, 1);
        let shared = HandleState::new(None);
        let mut worker = Worker::default();
        worker
            .spec
            .entries
            .push(HandleEntry::new(&shared, mailbox.reserve().unwrap()));
        let ending = {
            let mailbox = Arc::clone(&mailbox);
            thread::spawn(move || {
                mailbox.open();
                mailbox.empty(&mut worker);
                mailbox.close();
            })
        };
        match mailbox.send(Order::Remove(Arc::clone(&shared))) {
            Ok(()) => shared.gone.wait(),
            Err(declined) => assert_eq!(declined, Declined::Stopped),
        }
        ending.join().unwrap();
        drop(bell);
    });
}

// What the included files name besides: without protocols of their own.

type Tid = thread::ThreadId;

fn current_tid() -> Tid {
    thread::current().id()
}

/// The dispatcher's CPU account.
struct Account;

impl Account {
    fn has_budget(&self) -> bool {
        true
    }
    fn block(&mut self) {}
    fn activate(&mut self, _: u64) {}
}

mod stop {
    use crate::middleware::Fake;
    use crate::sync::Arc;

    #[derive(Clone)]
    pub(crate) struct StopHandle {
        pub(crate) stop: Arc<crate::handoff::Stop>,
        pub(crate) middleware: Arc<Fake>,
    }

    impl StopHandle {
        pub(crate) fn is_stopping(&self) -> bool {
            self.stop.is_requested()
        }
    }
}

mod doorbell {
    use crate::handoff::ReadySet;
    use crate::sync::{Arc, Notify};
    use std::sync::atomic::Ordering;

    pub(crate) struct Line {
        pub(crate) bell: Arc<Doorbell>,
        pub(crate) slot: usize,
    }

    impl Line {
        pub(crate) fn mark(&self) {
            self.bell.marks.mark(self.slot);
        }
    }

    pub(crate) struct Doorbell {
        signal: Notify,
        marks: ReadySet,
        /// The dispatcher's alone: not seen by the model.
        due: std::sync::atomic::AtomicBool,
    }

    impl Default for Doorbell {
        fn default() -> Self {
            Self {
                signal: Notify::new(),
                marks: ReadySet::new(1),
                due: false.into(),
            }
        }
    }

    impl Doorbell {
        pub(crate) fn owe(&self) {
            self.due.store(true, Ordering::Relaxed);
        }
        pub(crate) fn pay(&self, _now: &mut Option<u64>) {
            if self.due.swap(false, Ordering::Relaxed) {
                self.signal.set();
            }
        }
        pub(crate) fn call(&self) {
            self.signal.set();
        }
        pub(crate) fn wait(&self) {
            self.signal.wait();
        }
    }
}

mod entry {
    use crate::handle::HandleState;
    use crate::sync::Arc;

    pub(crate) struct HandleEntry {
        pub(crate) shared: Arc<HandleState>,
        pub(crate) handle: Handle,
        pub(crate) handling: HandleOptions,
        pub(crate) slot: usize,
    }

    pub(crate) struct HandleOptions {
        pub(crate) priority: u8,
    }

    /// The order is no matter of the models.
    pub(crate) fn insert(entries: &mut Vec<HandleEntry>, entry: HandleEntry) {
        entries.push(entry);
    }

    pub(crate) struct Handle;

    impl Handle {
        pub(crate) fn begin<B>(&mut self, _: u64, _: &B) {}
    }

    impl HandleEntry {
        pub(crate) fn new(shared: &Arc<HandleState>, slot: usize) -> Self {
            Self {
                shared: Arc::clone(shared),
                handle: Handle,
                handling: HandleOptions { priority: 0 },
                slot,
            }
        }
    }
}

mod worker {
    #[derive(Default)]
    pub(crate) struct Worker {
        pub(crate) spec: Spec,
    }

    #[derive(Default)]
    pub(crate) struct Spec {
        pub(crate) entries: Vec<crate::entry::HandleEntry>,
    }

    impl Worker {
        pub(crate) fn reordered(&mut self) {}
    }
}

mod error {
    #[derive(Debug)]
    pub(crate) enum Error {
        Capacity { what: String, limit: usize },
    }
}
