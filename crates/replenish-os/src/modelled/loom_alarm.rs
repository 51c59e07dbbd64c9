//! Every interleaving of the workers that set an enforcer's timer, the enforcer that reads it and
//! sets it again, and a stop. The alarm is the real one; the timer below it is a model.
#![allow(clippy::unwrap_used, reason = "test code")]

use crate::Nanos;
use crate::enforcer::alarm::Alarm;
use loom::sync::atomic::{AtomicBool, Ordering};
use loom::sync::{Arc, Condvar, Mutex};
use loom::thread;

/// A timer of the kernel. Setting it forgets an expiry that was not read; a thread that waits for
/// it sees the time pass.
#[derive(Default)]
struct Timer(Mutex<Option<Nanos>>, Condvar);

impl Timer {
    fn arm(&self, at: Nanos) -> Result<(), ()> {
        *self.0.lock().unwrap() = Some(at);
        self.1.notify_one();
        Ok(())
    }

    /// Time at which it fired.
    fn read(&self) -> Nanos {
        let mut set = self.0.lock().unwrap();
        loop {
            if let Some(at) = set.take() {
                return at;
            }
            set = self.1.wait(set).unwrap();
        }
    }
}

/// The state that the enforcer's lock guards.
struct Shared {
    alarm: Alarm,
    /// The checks that workers wait for.
    checks: Vec<Nanos>,
}

struct Model {
    shared: Mutex<Shared>,
    timer: Timer,
    stop: AtomicBool,
}

impl Model {
    fn new() -> Arc<Self> {
        Arc::new(Self {
            shared: Mutex::new(Shared {
                alarm: Alarm::new(),
                checks: Vec::new(),
            }),
            timer: Timer::default(),
            stop: AtomicBool::new(false),
        })
    }

    /// A worker wants to be looked at.
    fn want(&self, at: Nanos) {
        let mut shared = self.shared.lock().unwrap();
        shared.checks.push(at);
        shared.alarm.set(at, |at| self.timer.arm(at)).unwrap();
    }

    /// Runs one round of the enforcer; returns the time at which its timer fired.
    fn round(&self) -> Nanos {
        let now = self.timer.read();
        let mut shared = self.shared.lock().unwrap();
        shared.alarm.fired();
        shared.checks.retain(|at| *at > now);
        if let Some(next) = shared.checks.iter().copied().min() {
            shared.alarm.set(next, |at| self.timer.arm(at)).unwrap();
        }
        now
    }
}

/// A check that no thread looked after would leave the enforcer waiting: a deadlock for `loom`.
#[test]
fn every_check_is_looked_after() {
    loom::model(|| {
        let model = Model::new();
        let workers: Vec<_> = [5, 3]
            .into_iter()
            .map(|at| {
                let model = Arc::clone(&model);
                thread::spawn(move || model.want(at))
            })
            .collect();
        let mut last = 0;
        while last < 5 {
            last = model.round();
        }
        workers.into_iter().for_each(|w| w.join().unwrap());
        // A worker may have come after the round at 5; then the timer is set for it.
        while !model.shared.lock().unwrap().checks.is_empty() {
            model.round();
        }
    });
}

/// A stop ends the enforcer at once. On b209253 it was set without the lock, and a worker could put
/// it off to its own check.
#[test]
fn no_worker_puts_a_stop_off() {
    loom::model(|| {
        let model = Model::new();
        let worker = thread::spawn({
            let model = Arc::clone(&model);
            move || model.want(5)
        });
        let stopper = thread::spawn({
            let model = Arc::clone(&model);
            move || {
                model.stop.store(true, Ordering::SeqCst);
                let mut shared = model.shared.lock().unwrap();
                shared.alarm.set(1, |at| model.timer.arm(at)).unwrap();
            }
        });
        worker.join().unwrap();
        stopper.join().unwrap();
        assert_eq!(model.round(), 1);
        assert!(model.stop.load(Ordering::SeqCst));
    });
}
