//! Every interleaving of what a timer's handle wishes with the worker that fulfils it, and that may
//! be about to sleep or just beginning: no wish is lost, and of several the last holds. Over the real
//! `executor/timer.rs` and `executor/schedule.rs`; what they name besides are stubs.
//!
//! `RUSTFLAGS="--cfg loom" cargo test -p replenish --release --test "loom_*"`
#![cfg(loom)]
#![allow(clippy::unwrap_used, reason = "a model may panic")]
#![allow(
    dead_code,
    unused_imports,
    unused_macros,
    reason = "models use a part of what they include"
)]

extern crate alloc;
extern crate self as replenish_os;

#[path = "../src/executor/schedule.rs"]
mod schedule;
#[path = "../src/sync.rs"]
mod sync;
#[path = "../src/executor/timer.rs"]
mod timer;

use callback::CallbackContext;
use doorbell::Line;
use handle::{Env, Handle, Shared};
use loom::thread;
use schedule::Every;
use std::time::Duration;
use sync::{Arc, Signal};
use timer::{Timer, TimerHandle};

type Nanos = u64;

/// The time at which everything happens.
const NOW: Nanos = 1;

fn period(nanos: u64) -> Every {
    Every::period(Duration::from_nanos(nanos))
}

/// The worker's loop as far as one timer goes: begin, then look, and sleep until its bell is rung or
/// its next release is as `expected`; then whether it stays that.
fn work(handle: &TimerHandle, every: Every, expected: Option<Nanos>) {
    let shared = Arc::new(Shared::default());
    let line = Line(Arc::new(Signal::new()));
    let nothing = |_: &CallbackContext<'_>| ();
    let mut timer = Timer::new(shared, every, Some(handle.control()), nothing);
    timer.begin(NOW, &line);
    while timer.next_release() != expected {
        line.0.wait();
    }
    assert_eq!(timer.next_release(), expected);
    assert_eq!(handle.next_release(), expected);
}

#[test]
fn a_start_while_the_worker_begins_or_falls_asleep_is_heard() {
    loom::model(|| {
        let handle = TimerHandle::new();
        let other = handle.clone();
        let starter = thread::spawn(move || other.start());
        work(&handle, period(10).not_started(), Some(NOW + 10));
        starter.join().unwrap();
    });
}

#[test]
fn wishes_of_two_threads_are_both_fulfilled() {
    loom::model(|| {
        let handle = TimerHandle::new();
        let (starts, changes) = (handle.clone(), handle.clone());
        let threads = [
            thread::spawn(move || starts.start()),
            thread::spawn(move || changes.set_period(Duration::from_nanos(7)).unwrap()),
        ];
        // Whichever comes first: a change of period counts from the start.
        work(&handle, period(10).not_started(), Some(NOW + 7));
        threads.into_iter().for_each(|t| t.join().unwrap());
    });
}

#[test]
fn the_last_of_two_wishes_is_the_one_that_holds() {
    loom::model(|| {
        let handle = TimerHandle::new();
        let other = handle.clone();
        let changes = thread::spawn(move || {
            other.start();
            other.cancel();
            other.set_period(Duration::from_nanos(5)).unwrap();
            other.start();
        });
        work(&handle, period(10), Some(NOW + 5));
        changes.join().unwrap();
    });
}

// What the included files name besides.

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

    impl<T> Default for Once<T> {
        fn default() -> Self {
            Self::new()
        }
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
        pub(crate) fn call(&self) {
            self.0.set();
        }
    }
}

mod moment {
    pub(crate) struct Moment;

    impl Moment {
        pub(crate) fn get(&self) -> u64 {
            crate::NOW
        }
    }
}

mod handle {
    use crate::doorbell::Line;
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
        fn is_ready(&mut self, now: &crate::moment::Moment) -> bool;
        fn next_release(&mut self) -> Option<u64>;
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

mod error {
    #[derive(Debug)]
    pub(crate) struct Error;

    impl Error {
        pub(crate) fn parameter(_: &str, _: &str, _: &dyn core::fmt::Display, _: &str) -> Self {
            Self
        }
    }
}
