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

#[path = "../src/executor/wake/schedule.rs"]
mod schedule;
#[path = "common/loom_handles.rs"]
mod stubs;
#[path = "../src/executor/handles/timer.rs"]
mod timer;

use callback::CallbackContext;
use doorbell::Line;
use handle::{Env, Handle, HandleState};
use loom::thread;
use replenish_handoff::sync;
use schedule::Every;
use std::time::Duration;
use stubs::{callback, clock, doorbell, handle, lazy_now, platform, run_queue};
use sync::{Arc, Notify};
use timer::{Timer, TimerHandle};

/// The rooms of the executor, as the included files name them.
mod executor {
    pub(crate) mod handles {
        pub(crate) use crate::{callback, handle};
    }
    pub(crate) mod wake {
        pub(crate) use crate::{doorbell, lazy_now, run_queue, schedule};
    }
}

type Nanos = u64;

/// The time at which everything happens.
const NOW: Nanos = 1;

fn period(nanos: u64) -> Every {
    Every::period(Duration::from_nanos(nanos))
}

/// The worker's loop as far as one timer goes: begin, then look, and sleep until its bell is rung or
/// its next release is as `expected`; then whether it stays that.
fn work(handle: &TimerHandle, every: Every, expected: Option<Nanos>) {
    let shared = Arc::new(HandleState::default());
    let line = Line(Arc::new(Notify::new()));
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

mod error {
    #[derive(Debug)]
    pub(crate) struct Error;

    impl Error {
        pub(crate) fn parameter(_: &str, _: &str, _: &dyn core::fmt::Display, _: &str) -> Self {
            Self
        }
    }
}
