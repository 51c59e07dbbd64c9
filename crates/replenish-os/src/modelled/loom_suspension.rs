//! Every interleaving of a worker, its signal handler, its enforcer and a thread that waits for its
//! lock: `cargo xtask ci loom`. A lost wake-up would leave the worker asleep, which `loom` reports
//! as a deadlock.
//!
//! A signal arrives between two steps of the worker: the handler is called there if one is pending.
#![allow(clippy::unwrap_used, reason = "test code")]

use crate::linux::suspension::Suspension;
use loom::sync::Arc;
use loom::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use loom::thread;

fn model(f: impl Fn() + Send + Sync + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = builder.preemption_bound.or(Some(3));
    builder.check(f);
}

/// A worker, as the enforcer sees it.
struct Worker {
    suspension: Suspension,
    signal: AtomicBool,
    /// Whether the worker has the lock.
    owns: AtomicBool,
    /// A thread that must not be kept waiting has found the worker asleep with the lock.
    kept: AtomicBool,
}

impl Worker {
    fn new() -> Arc<Self> {
        Arc::new(Self {
            suspension: Suspension::new(),
            signal: AtomicBool::new(false),
            owns: AtomicBool::new(false),
            kept: AtomicBool::new(false),
        })
    }

    /// Between two steps.
    fn here(&self) {
        if self.signal.swap(false, Ordering::AcqRel) && self.suspension.stops_here() {
            assert!(
                !self.owns.load(Ordering::Relaxed),
                "the handler stops inside a section"
            );
            self.suspension.wait();
        }
    }

    fn section(&self) {
        self.here();
        self.suspension.enter();
        self.here();
        self.owns.store(true, Ordering::Relaxed);
        self.here();
        self.owns.store(false, Ordering::Relaxed);
        self.here();
        self.suspension.leave(|| 10);
        self.here();
    }

    /// The enforcer's two steps.
    fn stop(&self) {
        self.suspension.stop();
        self.signal.store(true, Ordering::Release);
    }
}

#[test]
fn loom_a_stopped_worker_goes_on_and_never_stops_in_a_section() {
    model(|| {
        let worker = Worker::new();
        let enforcer = thread::spawn({
            let worker = worker.clone();
            move || {
                worker.stop();
                worker.suspension.raise();
            }
        });
        worker.section();
        worker.suspension.begin(|| 10);
        enforcer.join().unwrap();
    });
}

/// No enforcer raises the worker: a cancel ends the wait, before or after the stop, and a later
/// stop does not stop it.
#[test]
fn loom_a_cancel_ends_every_stop() {
    model(|| {
        let worker = Worker::new();
        let enforcer = thread::spawn({
            let worker = worker.clone();
            move || worker.stop()
        });
        let executor = thread::spawn({
            let worker = worker.clone();
            move || worker.suspension.cancel()
        });
        worker.section();
        enforcer.join().unwrap();
        executor.join().unwrap();
        worker.stop();
        worker.section();
        worker.suspension.begin(|| 10);
    });
}

/// The worker has inherited too much and stops itself as it leaves; it may be raised meanwhile.
#[test]
fn loom_a_worker_that_stops_itself_is_raised() {
    model(|| {
        let worker = Worker::new();
        worker.suspension.lower(5);
        let enforcer = thread::spawn({
            let worker = worker.clone();
            move || worker.suspension.raise()
        });
        worker.suspension.enter();
        worker.suspension.boost_now(1);
        worker.suspension.leave(|| 10);
        enforcer.join().unwrap();
        assert_eq!(worker.suspension.boosted(99), 9);
    });
}

/// The thread stops with the section that uses the allowance up, and not before.
#[test]
fn loom_an_allowance_lasts_as_long_as_it_says() {
    model(|| {
        let worker = Worker::new();
        worker.suspension.lower(15);
        let other = thread::spawn({
            let worker = worker.clone();
            move || {
                for cpu in [10, 20] {
                    worker.suspension.enter();
                    worker.suspension.boost_now(cpu - 9);
                    worker.suspension.leave(|| cpu);
                    worker.owns.store(true, Ordering::Release); // here: it has got past a section
                }
                worker.kept.store(true, Ordering::Release);
            }
        });
        while !worker.owns.load(Ordering::Acquire) {
            thread::yield_now();
        }
        assert!(!worker.kept.load(Ordering::Acquire), "18 of 15");
        worker.suspension.raise();
        other.join().unwrap();
    });
}

/// A waiter's note never outlives the section that it was meant for, in either order; and a waiter
/// that found the section open is counted.
#[test]
fn loom_no_note_of_a_waiter_outlives_its_section() {
    model(|| {
        let worker = Arc::new(Suspension::new());
        let lock = Arc::new(AtomicU32::new(1));
        worker.enter();
        let waiter = thread::spawn({
            let (worker, lock) = (worker.clone(), lock.clone());
            move || {
                if lock.load(Ordering::SeqCst) == 1 && worker.boost(4) {
                    let late = lock.load(Ordering::SeqCst) != 1;
                    if late {
                        worker.boost_was_late(4);
                    }
                    return !late;
                }
                false
            }
        });
        lock.store(0, Ordering::SeqCst);
        worker.leave(|| 10);
        let counted = waiter.join().unwrap();
        let sum = worker.boosted(1000);
        assert!(sum == 0 || sum == 6, "{sum}");
        assert!(!counted || sum == 6);
    });
}

/// The enforcer reads while the worker adds: what it takes for inherited never exceeds it.
#[test]
fn loom_a_reading_never_exceeds_what_was_inherited() {
    model(|| {
        let worker = Arc::new(Suspension::new());
        worker.enter();
        worker.boost_now(4);
        let enforcer = thread::spawn({
            let worker = worker.clone();
            move || worker.boosted(9)
        });
        worker.leave(|| 9);
        assert!(enforcer.join().unwrap() <= 5);
        assert_eq!(worker.boosted(9), 5);
    });
}
