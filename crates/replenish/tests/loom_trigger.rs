//! Every interleaving of the first trigger of a guard condition with the worker that takes it over:
//! either the trigger sees whom to wake, or the worker sees the trigger. Over the real
//! `executor/guard.rs`; what it names besides are stubs.
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
extern crate self as replenish_os;

#[path = "../src/executor/handles/guard.rs"]
mod guard;
#[path = "common/loom_handles.rs"]
mod stubs;

use callback::CallbackContext;
use doorbell::Line;
use guard::{Guard, GuardCondition};
use handle::{Env, Handle, HandleState};
use lazy_now::LazyNow;
use loom::thread;
use replenish_handoff::{self as handoff, sync};
use stubs::{callback, clock, doorbell, handle, lazy_now, platform};
use sync::{Arc, Notify};

/// The rooms of the executor, as the included files name them.
mod executor {
    pub(crate) mod handles {
        pub(crate) use crate::{callback, handle};
    }
    pub(crate) mod wake {
        pub(crate) use crate::{doorbell, lazy_now};
    }
}

type Nanos = u64;

/// The worker's loop as far as one handle goes: begin, then look, serve, sleep.
fn serve(condition: &GuardCondition, all: u64) -> u64 {
    let shared = Arc::new(HandleState::default());
    let line = Line(Arc::new(Notify::new()));
    let nothing = |_: &CallbackContext<'_>| ();
    let mut guard = Guard::new(Arc::clone(&shared), condition.clone(), nothing);
    guard.begin(0, &line);
    let mut callbacks = 0;
    while shared.counters.received.get() < all {
        match guard.is_ready(&LazyNow) && guard.take(&Env { events: &() }).is_some() {
            true => callbacks += 1,
            false => line.0.wait(),
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
