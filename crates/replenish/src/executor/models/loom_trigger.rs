//! Every interleaving of the first trigger of a guard condition with the worker that takes the
//! condition over: either the trigger sees the worker's bell, or the worker sees the trigger.

use super::fake::{self, Fake};
use crate::event::Events;
use crate::executor::handles::callback::CallbackContext;
use crate::executor::handles::env::Env;
use crate::executor::handles::guard::{Guard, GuardCondition};
use crate::executor::handles::handle::Handle;
use crate::executor::handles::state::HandleState;
use crate::executor::wake::lazy_now::LazyNow;
use crate::sync::Arc;
use loom::thread;
use replenish_os::Account;

/// The worker's loop as far as one handle goes: begin, then look, serve, sleep.
fn serve(condition: &GuardCondition, all: u64) -> u64 {
    let shared = HandleState::new("guard".into(), None);
    let wake = fake::wake_handle();
    let nothing = |_: &CallbackContext<'_>| ();
    let mut guard = Guard::new(Arc::clone(&shared), condition.clone(), nothing);
    guard.begin(0, &wake);
    let middleware = Fake::holding(&[]);
    let stop = middleware.stop_handle();
    let env = Env {
        worker: "w",
        stop: &stop,
        events: &Events::default(),
        meter: &Account::unbudgeted().meter(),
        middleware: &middleware,
        live: None,
        outbox: None,
    };
    let mut callbacks = 0;
    while shared.counters.received.get() < all {
        if guard.is_ready(&LazyNow::default()) && guard.take(&env).is_some() {
            callbacks += 1;
        } else {
            wake.bell().wait(None);
        }
    }
    assert_eq!(shared.counters.received.get(), all);
    assert_eq!(callbacks + shared.counters.skipped.get(), all);
    callbacks
}

#[test]
fn a_trigger_while_the_worker_begins_is_served() {
    loom::model(|| {
        let condition = GuardCondition::new();
        let other = condition.clone();
        let trigger = thread::spawn(move || other.trigger());
        assert_eq!(serve(&condition, 1), 1);
        trigger.join().unwrap();
    });
}

#[test]
fn two_triggers_while_the_worker_begins_are_served_alone_or_together() {
    loom::model(|| {
        let condition = GuardCondition::new();
        let triggers = [(); 2].map(|()| {
            let other = condition.clone();
            thread::spawn(move || other.trigger())
        });
        assert!((1..=2).contains(&serve(&condition, 2)));
        triggers.into_iter().for_each(|t| t.join().unwrap());
    });
}
