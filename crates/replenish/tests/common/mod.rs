//! Helpers of the executor's tests: waiting for a condition or for rest, a gate to hold a callback,
//! quiet events, and a middleware that does what a script says.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test target uses a part of it"
)]

#[cfg(feature = "xrce")]
pub mod agent;
#[cfg(feature = "xrce")]
pub mod bridge;
pub mod fibonacci;
#[cfg(feature = "xrce")]
pub mod relay;
pub mod scripted;

use replenish::msg::{Service, std_msgs::Int32};
use replenish::{Context, Event, Executor};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

/// A service that gives a number for a number.
pub struct Echo;

impl Service for Echo {
    type Request = Int32;
    type Response = Int32;
    const TYPE_NAME: &'static str = "test_msgs/srv/Echo";
}

pub use replenish_testkit::progress::eventually;

/// Waits for 100 ms in which `state` stays the same; `false` after a minute. A loaded machine lets
/// a thread come to rest late; a thread that spins never rests.
#[must_use]
pub fn settles<T: PartialEq>(state: impl Fn() -> T) -> bool {
    eventually(|| {
        let before = state();
        std::thread::sleep(Duration::from_millis(100));
        state() == before
    })
}

/// Holds callbacks until it is opened.
#[derive(Clone, Default)]
pub struct Gate(Arc<(Mutex<(bool, u32)>, Condvar)>);

impl Gate {
    #[must_use]
    pub fn closed() -> Self {
        Self::default()
    }

    /// Called by the callback.
    pub fn pass(&self) {
        let (state, changed) = &*self.0;
        let mut state = state.lock().unwrap();
        state.1 += 1;
        changed.notify_all();
        while !state.0 {
            state = changed.wait(state).unwrap();
        }
    }

    /// Waits until some callback has arrived at the gate.
    pub fn arrived(&self) {
        let (state, changed) = &*self.0;
        let mut state = state.lock().unwrap();
        while state.1 == 0 {
            state = changed.wait(state).unwrap();
        }
    }

    pub fn open(&self) {
        let (state, changed) = &*self.0;
        state.lock().unwrap().0 = true;
        changed.notify_all();
    }
}

/// The events that an executor reported.
#[derive(Clone, Default)]
pub struct Log(Arc<Mutex<Vec<String>>>);

impl Log {
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        self.0.lock().unwrap().clone()
    }

    #[must_use]
    pub fn has(&self, part: &str) -> bool {
        self.lines().iter().any(|l| l.contains(part))
    }
}

/// An executor whose events end up in the log instead of on standard error.
pub fn executor(ctx: &Context) -> (Executor, Log) {
    let log = Log::default();
    let sink = log.clone();
    let mut exec = Executor::new(ctx);
    // Other tests run at the same time; those of the ledger have one of their own.
    exec.no_ledger();
    exec.on_event(move |e: &Event<'_>| sink.0.lock().unwrap().push(e.to_string()));
    (exec, log)
}

/// The CPU for real-time experiments: the last one this process may use.
#[must_use]
pub fn cpu() -> usize {
    let allowed = replenish_os::affinity(replenish_os::current_tid()).unwrap();
    allowed.iter().last().unwrap()
}

/// Consumes `ms` milliseconds of CPU time of the calling thread.
pub fn burn(ms: u64) {
    let end = replenish_os::clock::thread_cpu() + ms * 1_000_000;
    while replenish_os::clock::thread_cpu() < end {}
}
