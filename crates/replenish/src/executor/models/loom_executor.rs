//! Every interleaving of the executor's own protocols: the dispatcher with its interest set, the
//! updates of routes, the mailbox through which handles come and go.

use super::fake::{self, Fake};
use crate::event::Events;
use crate::executor::handles::entry::HandleEntry;
use crate::executor::handles::env::Env;
use crate::executor::handles::handle::{Handle, Taken};
use crate::executor::handles::state::HandleState;
use crate::executor::run::accounting::CpuAccounting;
use crate::executor::run::dispatcher::{Dispatcher, DispatcherCounters};
use crate::executor::run::route_updates::RouteUpdates;

use crate::executor::run::routes::Route;
use crate::executor::run::state::Worker;
use crate::executor::start::assembly::assemble;
use crate::executor::wake::doorbell::WakeHandle;
use crate::executor::wake::lazy_now::LazyNow;
use crate::handoff::{Declined, Inbox, Keep};
use crate::middleware::{Interest, Middleware, ReaderId};
use crate::sync::{Arc, AtomicBool, Ordering};
use crate::{Context, Executor};
use alloc::boxed::Box;
use loom::thread;
use replenish_os::Account;

fn reader(id: u16) -> ReaderId {
    ReaderId(id)
}

fn shared(input: Option<(ReaderId, Arc<Inbox>)>) -> Arc<HandleState> {
    HandleState::new("h".into(), input)
}

/// A route to the worker that `wake` wakes.
fn route(shared: &Arc<HandleState>, wake: &WakeHandle) -> Route {
    Route::new(Arc::clone(shared), wake.clone())
}

/// A handle without input.
struct Idle;

impl Handle for Idle {
    fn is_ready(&mut self, _: &LazyNow) -> bool {
        false
    }
    fn take(&mut self, _: &Env<'_>) -> Option<Taken> {
        None
    }
    fn execute(&mut self, _: &Env<'_>, _: u64) {}
}

fn entry(shared: &Arc<HandleState>, slot: usize) -> HandleEntry {
    let mut entry = HandleEntry::new(Arc::clone(shared), Box::new(Idle));
    entry.slot = slot;
    entry
}

/// A worker that may have `limit` handles, and has none.
fn worker(limit: usize) -> Box<Worker> {
    let context = Context::new(Fake::holding(&[]));
    let mut executor = Executor::new(&context);
    executor.worker("w").capacity(limit);
    let Executor {
        workers,
        stop,
        options,
        ..
    } = executor;
    let mut assembly = assemble(&context, workers.begin(), &stop, &options.events);
    assembly.workers.remove(0)
}

/// Reader 0 is full after its first sample and leaves the interest set. Reader 1, behind it, gets
/// what is its own meanwhile; reader 0 gets the rest as soon as there is room; the stop ends it.
#[test]
fn a_full_reader_leaves_the_interest_set_holds_up_nobody_and_comes_back() {
    loom::model(|| {
        let middleware = Fake::holding(&[(reader(0), 1), (reader(0), 2), (reader(1), 3)]);
        let inboxes = [(); 2].map(|()| Arc::new(Inbox::new(1, 1, Keep::All)));
        let shared = [0, 1].map(|id| {
            let inbox = Arc::clone(&inboxes[usize::from(id)]);
            shared(Some((reader(id), inbox)))
        });
        let stop = middleware.stop_handle();
        let wake = fake::wake_handle();
        let bell = Arc::clone(wake.bell());
        let mut dispatcher = Dispatcher {
            stop: stop.clone(),
            middleware: Arc::new(middleware.clone()),
            events: Arc::new(Events::default()),
            counters: Arc::new(DispatcherCounters::default()),
            routes: shared.iter().map(|s| Some(route(s, &wake))).collect(),
            updates: RouteUpdates::new(),
            bells: vec![Arc::clone(&bell)],
        };
        let dispatcher = thread::spawn(move || dispatcher.run(&mut Account::unbudgeted()));
        while inboxes[1].waiting() == 0 {
            bell.wait(None);
        }
        let (mut got, mut hands) = (Vec::new(), [None, None]);
        while got.len() < 3 {
            let both = inboxes.iter().zip(&mut hands);
            let popped = both.filter_map(|(inbox, read_slot)| {
                if inbox.pop(read_slot)? {
                    middleware.wake();
                }
                Some(read_slot.as_ref()?.payload()[0])
            });
            let before = got.len();
            got.extend(popped);
            if got.len() == before {
                bell.wait(None);
            }
        }
        got.retain(|sample| *sample != 3);
        assert_eq!(got, [1, 2]);
        stop.stop.request();
        middleware.wake();
        dispatcher.join().unwrap();
    });
}

/// Two threads add routes while the dispatcher looks at the updates: it sees both before it sleeps.
#[test]
fn no_order_is_left_on_the_desk() {
    loom::model(|| {
        let updates = RouteUpdates::new();
        let middleware = Fake::holding(&[]);
        let threads: Vec<_> = [0, 1]
            .map(|id| {
                let (updates, middleware) = (Arc::clone(&updates), middleware.clone());
                thread::spawn(move || {
                    let reserved = updates.reserve().unwrap();
                    reserved.update(reader(id), Some(route(&shared(None), &fake::wake_handle())));
                    middleware.wake();
                })
            })
            .into();
        let mut routes = [None, None];
        let (mut interest, mut parked) = (Interest::empty(), Interest::empty());
        loop {
            updates.carry_out(&middleware, &mut routes, &mut interest, &mut parked);
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
        let updates = RouteUpdates::new();
        let middleware = Fake::holding(&[]);
        let shared = shared(None);
        let mut routes = [Some(route(&shared, &fake::wake_handle()))];
        let dispatcher = {
            let (updates, middleware) = (Arc::clone(&updates), middleware.clone());
            thread::spawn(move || {
                let mut interest = Interest::empty();
                let mut parked = Interest::empty();
                interest.insert(reader(0));
                while !interest.is_empty() {
                    middleware.wait(&Interest::empty(), None).unwrap();
                    updates.carry_out(&middleware, &mut routes, &mut interest, &mut parked);
                }
                assert!(routes[0].is_none());
            })
        };
        updates.reserve().unwrap().update(reader(0), None);
        middleware.wake();
        while !shared.departure.is_unrouted() {
            thread::yield_now();
        }
        updates.free_retired();
        assert_eq!(
            Arc::strong_count(&shared),
            1,
            "the queue or the dispatcher has it"
        );
        assert_eq!(middleware.deleted(), 1);
        dispatcher.join().unwrap();
    });
}

/// One more handle of `worker`, as if it had been described.
fn give(worker: &mut Worker, shared: &Arc<HandleState>) {
    let mailbox = Arc::clone(&worker.mailbox);
    let reserved = mailbox.reserve().unwrap_or_else(|_| unreachable!());
    worker.spec.entries.push(entry(shared, reserved.slot()));
    core::mem::forget(reserved); // the entry has the slot
}

/// The worker's loop as far as its mailbox goes; `visit` is its round, which says whether to end.
fn work(worker: &mut Worker, visit: impl Fn(&Worker) -> bool) {
    let mut account = Account::unbudgeted();
    let accounting = CpuAccounting::new(account.meter());
    worker.mailbox.open();
    loop {
        worker.empty_mailbox(&mut account, &accounting);
        if visit(worker) {
            return;
        }
        worker.bell.wait(None);
    }
}

/// Two threads add a handle each: the worker gets both before it sleeps for good.
#[test]
fn handles_of_two_threads_arrive() {
    loom::model(|| {
        let mut worker = worker(2);
        let threads: Vec<_> = (0..2)
            .map(|_| {
                let mailbox = Arc::clone(&worker.mailbox);
                thread::spawn(move || {
                    let reserved = mailbox.reserve().unwrap_or_else(|_| unreachable!());
                    let entry = entry(&shared(None), reserved.slot());
                    assert!(mailbox.add(reserved, entry).is_ok());
                })
            })
            .collect();
        work(&mut worker, |w| w.spec.entries.len() == 2);
        assert!(matches!(
            worker.mailbox.reserve(),
            Err(Declined::Full { limit: 2 })
        ));
        threads.into_iter().for_each(|t| t.join().unwrap());
    });
}

/// A removal that has waited: no callback starts any more, the worker has dropped the callback, and
/// its place is free again.
#[test]
fn after_a_removal_no_callback_starts_and_the_place_is_free() {
    loom::model(|| {
        let mut worker = worker(1);
        let (mailbox, bell) = (Arc::clone(&worker.mailbox), Arc::clone(&worker.bell));
        let shared = shared(None);
        let stop = Arc::new(AtomicBool::new(false));
        let freed = Arc::new(AtomicBool::new(false));
        give(&mut worker, &shared);
        let running = {
            let (stop, freed) = (Arc::clone(&stop), Arc::clone(&freed));
            thread::spawn(move || {
                work(&mut worker, |worker| {
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
        assert!(mailbox.remove(&shared));
        shared.departure.gone.wait();
        freed.store(true, Ordering::Release);
        mailbox.sweep();
        assert!(mailbox.reserve().is_ok());
        stop.store(true, Ordering::Release);
        bell.force();
        assert_eq!(running.join().unwrap(), 0);
        assert_eq!(Arc::strong_count(&shared), 1);
    });
}

/// The worker ends while another thread removes a handle: the removal is declined or answered.
#[test]
fn nobody_waits_for_a_worker_that_has_ended() {
    loom::model(|| {
        let mut worker = worker(1);
        let mailbox = Arc::clone(&worker.mailbox);
        let shared = shared(None);
        give(&mut worker, &shared);
        let ending = thread::spawn(move || {
            let mut account = Account::unbudgeted();
            let accounting = CpuAccounting::new(account.meter());
            worker.mailbox.open();
            worker.empty_mailbox(&mut account, &accounting);
            worker.end(&mut account, &accounting);
        });
        if mailbox.remove(&shared) {
            shared.departure.gone.wait();
        } else {
            assert!(matches!(mailbox.reserve(), Err(Declined::Closed)));
        }
        ending.join().unwrap();
    });
}
