//! Every interleaving of a timer's handle with the worker that serves the timer, and that may be
//! about to sleep or just beginning. No change is lost, and of several the last one holds.

use super::fake;
use crate::Nanos;
use crate::executor::handles::callback::CallbackContext;
use crate::executor::handles::handle::Handle;
use crate::executor::handles::state::HandleState;
use crate::executor::handles::timer::{Timer, TimerHandle};
use crate::executor::wake::schedule::Every;
use core::time::Duration;
use loom::thread;
use replenish_os::clock;

/// The time at which everything happens.
const NOW: Nanos = 1;

fn period(nanos: u64) -> Every {
    Every::period(Duration::from_nanos(nanos))
}

/// The worker's loop as far as one timer goes: begin, then look, and sleep until its bell is rung
/// or its next release is as `expected`; then whether it stays that.
fn work(handle: &TimerHandle, every: Every, expected: Option<Nanos>) {
    let wake = fake::wake_handle();
    let nothing = |_: &CallbackContext<'_>| ();
    let shared = HandleState::new("timer".into(), None);
    let mut timer = Timer::new(shared, every, Some(handle.control()), nothing);
    timer.begin(NOW, &wake);
    while timer.next_release() != expected {
        wake.bell().wait(None);
    }
    assert_eq!(timer.next_release(), expected);
    assert_eq!(handle.next_release(), expected);
}

#[test]
fn a_start_while_the_worker_begins_or_falls_asleep_is_heard() {
    loom::model(|| {
        clock::set(NOW);
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
        clock::set(NOW);
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
        clock::set(NOW);
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
