//! Every interleaving of the hand-off cell:
//! `RUSTFLAGS="--cfg loom" cargo test --release -p replenish-os --lib loom_`.
#![allow(
    unsafe_code,
    clippy::unwrap_used,
    reason = "test code; plain memory as the thing handed over"
)]

use crate::Notify;
use loom::cell::UnsafeCell;
use loom::sync::Arc;
use loom::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use loom::thread;

/// All interleavings with up to three preemptions, which is where bugs of such small protocols
/// are; without a bound the models with three threads take minutes. `LOOM_MAX_PREEMPTIONS`
/// changes the bound.
fn model(f: impl Fn() + Send + Sync + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = builder.preemption_bound.or(Some(3));
    builder.check(f);
}

/// A lost wake-up would leave the waiter asleep, which `loom` reports as a deadlock.
#[test]
fn a_set_always_ends_the_wait() {
    model(|| {
        let signal = Arc::new(Notify::new());
        let setter = thread::spawn({
            let signal = Arc::clone(&signal);
            move || signal.set()
        });
        signal.wait();
        assert!(!signal.take(), "one set was consumed twice");
        setter.join().unwrap();
    });
}

#[test]
fn a_set_before_the_wait_returns_at_once() {
    model(|| {
        let signal = Notify::new();
        signal.set();
        signal.set();
        signal.wait(); // nobody else is there to wake this thread
        assert!(!signal.take());
        assert!(!signal.wait_until(1));
    });
}

/// A setter's writes before its set are visible after the wait, although the cell alone
/// synchronises (`Relaxed` flags) and although sets coalesce: otherwise the waiter would miss a
/// flag and wait for a set that never comes.
#[test]
fn what_setters_wrote_is_visible_also_when_sets_coalesce() {
    model(|| {
        let signal = Arc::new(Notify::new());
        let flags = Arc::new([AtomicBool::new(false), AtomicBool::new(false)]);
        let setters: Vec<_> = (0..2)
            .map(|i| {
                let (signal, flags) = (signal.clone(), flags.clone());
                thread::spawn(move || {
                    flags[i].store(true, Ordering::Relaxed);
                    signal.set();
                })
            })
            .collect();
        while !flags.iter().all(|flag| flag.load(Ordering::Relaxed)) {
            signal.wait();
        }
        for setter in setters {
            setter.join().unwrap();
        }
    });
}

/// Plain memory handed over by one set is free of data races.
#[test]
fn plain_memory_is_handed_over() {
    model(|| {
        let signal = Arc::new(Notify::new());
        let slot = Arc::new(UnsafeCell::new(0));
        let setter = thread::spawn({
            let (signal, slot) = (signal.clone(), slot.clone());
            move || {
                // SAFETY: the slot belongs to this thread until it signals.
                slot.with_mut(|slot| unsafe { *slot = 1 });
                signal.set();
            }
        });
        signal.wait();
        // SAFETY: the setter has handed the slot over.
        assert_eq!(slot.with(|slot| unsafe { *slot }), 1);
        setter.join().unwrap();
    });
}

/// The deadline may beat the set or not; the set is never lost to it.
#[test]
fn a_timeout_never_swallows_a_set() {
    model(|| {
        let signal = Arc::new(Notify::new());
        let setter = thread::spawn({
            let signal = Arc::clone(&signal);
            move || signal.set()
        });
        if !signal.wait_until(1) {
            signal.wait();
        }
        assert!(!signal.take());
        setter.join().unwrap();
    });
}

/// The worker's loop: wait, take what is there, look at the stop flag. A producer hands over one
/// item, then the loop has to stop: it ends, and the item has been seen.
#[test]
fn the_stop_protocol_ends_the_worker_after_its_last_item() {
    model(|| {
        let signal = Arc::new(Notify::new());
        let item = Arc::new(AtomicBool::new(false));
        let stop = Arc::new(AtomicBool::new(false));
        let worker = thread::spawn({
            let (signal, item, stop) = (signal.clone(), item.clone(), stop.clone());
            move || {
                let mut seen = 0;
                loop {
                    signal.wait();
                    let stopping = stop.load(Ordering::Acquire);
                    if item.swap(false, Ordering::AcqRel) {
                        seen += 1;
                    }
                    if stopping {
                        return seen;
                    }
                }
            }
        });
        item.store(true, Ordering::Release);
        signal.set();
        stop.store(true, Ordering::Release);
        signal.set();
        assert_eq!(worker.join().unwrap(), 1);
    });
}

/// Two producers and a worker that counts: every item is counted although sets coalesce.
#[test]
fn no_item_is_left_behind_by_coalescing() {
    model(|| {
        let signal = Arc::new(Notify::new());
        let items = Arc::new(AtomicU32::new(0));
        let producers: Vec<_> = (0..2)
            .map(|_| {
                let (signal, items) = (signal.clone(), items.clone());
                thread::spawn(move || {
                    items.fetch_add(1, Ordering::AcqRel);
                    signal.set();
                })
            })
            .collect();
        let mut taken = 0;
        while taken < 2 {
            signal.wait();
            taken += items.swap(0, Ordering::AcqRel);
        }
        assert_eq!(taken, 2);
        for producer in producers {
            producer.join().unwrap();
        }
    });
}

/// A set ends a wait for descriptors, whether it comes before the wait, at its begin or later.
#[test]
fn a_set_always_ends_a_wait_elsewhere() {
    model(|| {
        let signal = Arc::new(Notify::new());
        let setter = thread::spawn({
            let signal = Arc::clone(&signal);
            move || signal.set()
        });
        while !signal
            .wait_elsewhere(|| signal.modelled_descriptor().wait())
            .0
        {}
        assert!(!signal.take(), "one set was consumed twice");
        setter.join().unwrap();
    });
}

/// Another descriptor ends the wait while a set comes: the set is seen now or later, and the next
/// wait ends for it at most once without a set.
#[test]
fn a_wait_that_ends_elsewhere_loses_no_set() {
    model(|| {
        let signal = Arc::new(Notify::new());
        let setter = thread::spawn({
            let signal = Arc::clone(&signal);
            move || signal.set()
        });
        let (consumed, _) = signal.wait_elsewhere(thread::yield_now);
        if !consumed {
            while !signal
                .wait_elsewhere(|| signal.modelled_descriptor().wait())
                .0
            {}
        }
        setter.join().unwrap();
        assert!(!signal.take());
        signal.set();
        assert_eq!(signal.wait_elsewhere(|| ()), (true, None));
    });
}
