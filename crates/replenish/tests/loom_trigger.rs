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

#[path = "../src/executor/guard.rs"]
mod guard;
#[path = "../src/handoff/mod.rs"]
mod handoff;
#[path = "../src/sync.rs"]
mod sync;

use callback::CallbackContext;
use doorbell::Line;
use guard::{Guard, GuardCondition};
use handle::{Env, Handle, Shared};
use loom::thread;
use moment::Moment;
use sync::{Arc, Signal};

type Nanos = u64;

/// The worker's loop as far as one handle goes: begin, then look, serve, sleep.
fn serve(condition: &GuardCondition, all: u64) -> u64 {
    let shared = Arc::new(Shared::default());
    let line = Line(Arc::new(Signal::new()));
    let nothing = |_: &CallbackContext<'_>| ();
    let mut guard = Guard::new(Arc::clone(&shared), condition.clone(), nothing);
    guard.begin(0, &line);
    let mut callbacks = 0;
    while shared.counters.received.get() < all {
        match guard.is_ready(&Moment) && guard.take(&Env { events: &() }).is_some() {
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

// What the included file names besides.

mod clock {
    pub(crate) fn monotonic() -> u64 {
        1
    }
}

mod platform {
    use loom::sync::atomic::{AtomicBool, Ordering};
    use std::sync::OnceLock;

    /// `OnceLock` with what others see of it in the hands of the model.
    pub(crate) struct Once<T> {
        value: OnceLock<T>,
        there: AtomicBool,
    }

    impl<T> Once<T> {
        pub(crate) fn new() -> Self {
            Self {
                value: OnceLock::new(),
                there: AtomicBool::new(false),
            }
        }
        pub(crate) fn set(&self, value: T) -> Result<(), T> {
            self.value.set(value)?;
            self.there.store(true, Ordering::Release);
            Ok(())
        }
        pub(crate) fn get(&self) -> Option<&T> {
            match self.there.load(Ordering::Acquire) {
                true => self.value.get(),
                false => None,
            }
        }
    }
}

mod doorbell {
    use crate::sync::{Arc, Signal};

    #[derive(Clone)]
    pub(crate) struct Line(pub(crate) Arc<Signal>);

    impl Line {
        pub(crate) fn ring(&self, _: u64) {
            self.0.set();
        }
    }
}

mod moment {
    pub(crate) struct Moment;
}

mod handle {
    use crate::doorbell::Line;
    use crate::moment::Moment;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// Statistics are not part of the protocol: not seen by the model.
    #[derive(Default)]
    pub(crate) struct Counter(AtomicU64);

    impl Counter {
        pub(crate) fn add(&self, n: u64) {
            self.0.fetch_add(n, Ordering::Relaxed);
        }
        pub(crate) fn get(&self) -> u64 {
            self.0.load(Ordering::Relaxed)
        }
    }

    #[derive(Default)]
    pub(crate) struct Counters {
        pub(crate) received: Counter,
        pub(crate) skipped: Counter,
    }

    #[derive(Default)]
    pub(crate) struct Shared {
        pub(crate) counters: Counters,
    }

    impl Shared {
        pub(crate) fn failed(&self, _: &dyn core::fmt::Display, _: &()) {}
    }

    pub(crate) struct Env<'a> {
        pub(crate) events: &'a (),
    }

    pub(crate) struct Taken {
        pub(crate) due: u64,
        pub(crate) deadline: Option<u64>,
    }

    pub(crate) trait Handle {
        fn begin(&mut self, start: u64, line: &Line);
        fn is_ready(&mut self, now: &Moment) -> bool;
        fn take(&mut self, env: &Env<'_>) -> Option<Taken>;
        fn execute(&mut self, env: &Env<'_>, started: u64);
    }
}

mod callback {
    use crate::handle::{Env, Shared};
    use core::marker::PhantomData;

    pub(crate) struct CallbackContext<'a> {
        pub(crate) skipped: u64,
        pub(crate) stub: PhantomData<&'a ()>,
    }

    impl<'a> CallbackContext<'a> {
        pub(crate) fn new(_: &Env<'a>, _: &Shared, _: u64, _: u64) -> Self {
            Self {
                skipped: 0,
                stub: PhantomData,
            }
        }
    }

    pub(crate) trait CallbackResult {
        fn inspect(self, report: &mut dyn FnMut(&dyn core::fmt::Display));
    }

    impl CallbackResult for () {
        fn inspect(self, _: &mut dyn FnMut(&dyn core::fmt::Display)) {}
    }
}
