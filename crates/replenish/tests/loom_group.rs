//! Every interleaving of callbacks of one group on two workers: one at a time, each known as the one
//! who is inside for exactly as long as it is, and a wait that lasts is told with the name of another.
//! Over the real `executor/group.rs`; what it names besides are stubs.
//!
//! `RUSTFLAGS="--cfg loom" cargo test -p replenish --release --test "loom_*"`
#![cfg(loom)]
#![allow(clippy::unwrap_used, reason = "a model may panic")]
#![allow(
    dead_code,
    unused_imports,
    unreachable_pub,
    reason = "models use a part of what they include"
)]

extern crate alloc;
extern crate self as replenish_os; // the stubs of it are at the end

#[path = "../src/executor/handles/group.rs"]
mod group;
#[path = "../src/executor/wake/schedule.rs"]
mod schedule;

use event::Events;
use group::Group;
use handle::{Env, HandleState};
use loom::cell::UnsafeCell;
use loom::sync::MutexGuard as PiMutexGuard;
use loom::thread::{self, ThreadId as Tid};
use replenish_handoff::sync;
use std::time::Duration;
use sync::Arc;

/// The rooms of the executor, as the included files name them.
mod executor {
    pub(crate) mod handles {
        pub(crate) use crate::handle;
    }
    pub(crate) mod wake {
        pub(crate) use crate::schedule;
    }
}

type Nanos = u64;

/// What callbacks of the group share; `loom` sees two that touch it at the same time.
type Content = UnsafeCell<()>;

/// A worker that runs one callback of the group; whom it was told to wait for.
fn work(group: &Group, content: &Content, id: &'static str) -> Vec<String> {
    let shared = Arc::new(HandleState::of(id));
    assert!(!group.is_mine());
    {
        let _held = group.enter(&shared, &Env { events: &Events });
        content.with_mut(|_| ());
        assert!(group.is_mine(), "{id} is inside");
    }
    assert!(!group.is_mine(), "{id} has left");
    shared.told.take()
}

fn two_workers(patience: Duration) {
    loom::model(move || {
        let group = Group::new("g").patience(patience);
        let content = Arc::new(Content::new(()));
        let other = {
            let (group, content) = (group.clone(), Arc::clone(&content));
            thread::spawn(move || work(&group, &content, "other"))
        };
        let told = work(&group, &content, "this");
        // Who has just come in may not have said so yet.
        let waited_for = |name| move |by: &String| by == name || by == "-";
        assert!(told.iter().all(waited_for("other")), "{told:?}");
        let told = other.join().unwrap();
        assert!(told.iter().all(waited_for("this")), "{told:?}");
        assert!(content.with_mut(|_| true));
    });
}

#[test]
fn one_at_a_time_and_each_knows_when_it_is_inside() {
    two_workers(Duration::MAX);
}

#[test]
fn whoever_loses_patience_is_told_of_the_other_and_waits_on() {
    two_workers(Duration::from_nanos(1));
}

// What the included file names besides.

fn current_tid() -> Tid {
    thread::current().id()
}

mod clock {
    pub(crate) fn monotonic() -> u64 {
        1
    }
}

mod event {
    pub(crate) struct Events;

    pub(crate) enum Event<'a> {
        Blocked {
            handle: &'a str,
            group: &'a str,
            by: &'a str,
            waited: u64,
        },
    }
}

mod handle {
    use crate::event::{Event, Events};

    pub(crate) struct Env<'a> {
        pub(crate) events: &'a Events,
    }

    /// What is told is the thread's own, that is no part of the model.
    pub(crate) struct HandleState {
        pub(crate) id: String,
        pub(crate) told: Told,
    }

    #[derive(Default)]
    pub(crate) struct Told(std::sync::Mutex<Vec<String>>);

    impl Told {
        pub(crate) fn take(&self) -> Vec<String> {
            std::mem::take(&mut self.0.lock().unwrap())
        }
    }

    impl HandleState {
        pub(crate) fn of(id: &str) -> Self {
            Self {
                id: id.into(),
                told: Told::default(),
            }
        }
        pub(crate) fn report(&self, _: u64, event: &Event<'_>, _: &Events) {
            let Event::Blocked { handle, by, .. } = event;
            assert_eq!(*handle, self.id);
            self.told.0.lock().unwrap().push((*by).into());
        }
    }
}
