//! What a worker sleeps on: a signal, and when it was given.
//!
//! A budget comes back one period after the worker became *runnable*, which is when its bell was
//! rung or its timer's release came, not when it got the CPU. Taking a time that is too late only
//! delays a replenishment; one that is too early would advance it, so it is never before the
//! moment the worker went to sleep.
//!
//! In an executor without threads, everything is waited for on the middleware, and the bell ends that
//! wait: [`Middleware::wake`], which is an atomic operation and one system call at most.
//!
//! A worker whose rounds come by the clock alone has its bell *muted*: new data does not ring it.

use crate::Nanos;
use crate::handoff::ReadySet;
use crate::middleware::Middleware;
use crate::sync::{Arc, AtomicBool, AtomicU64, Notify, Once, Ordering};
use replenish_os::clock;

/// The way of one handle's input to its worker: the bell, and the mark that says which handle.
#[derive(Clone)]
pub(crate) struct Line {
    pub(crate) bell: Arc<Doorbell>,
    pub(crate) slot: usize,
}

impl Line {
    /// There is input for the handle, and the bell is yet to be rung. Async-signal-safe.
    pub(crate) fn mark(&self) {
        self.bell.marks.mark(self.slot);
    }

    /// There is input for the handle, since `now`. Async-signal-safe.
    pub(crate) fn ring(&self, now: Nanos) {
        self.mark();
        self.bell.ring(now);
    }

    /// Something about the handle has changed: rings also when muted.
    pub(crate) fn call(&self) {
        self.mark();
        self.bell.call();
    }
}

/// Rung by the dispatcher or by a stop; one worker sleeps on it.
pub(crate) struct Doorbell {
    signal: Arc<Notify>,
    rung_at: AtomicU64,
    muted: AtomicBool,
    /// The dispatcher has brought something and is yet to ring.
    due: AtomicBool,
    /// Whose input has come.
    pub(crate) marks: ReadySet,
    /// What the worker sleeps on instead, if it has no thread of its own.
    relay: Once<Arc<dyn Middleware>>,
}

impl Doorbell {
    /// For a worker with handles in slots below `slots`.
    pub(crate) fn new(slots: usize) -> Self {
        Self {
            signal: Arc::new(Notify::new()),
            rung_at: AtomicU64::new(0),
            muted: AtomicBool::new(false),
            due: AtomicBool::new(false),
            marks: ReadySet::new(slots),
            relay: Once::new(),
        }
    }

    /// The signal alone, for those who do not bring work.
    pub(crate) fn signal(&self) -> &Arc<Notify> {
        &self.signal
    }

    /// There is work, since `now`. Async-signal-safe.
    pub(crate) fn ring(&self, now: Nanos) {
        if !self.muted.load(Ordering::Relaxed) {
            self.rung_at.store(now, Ordering::Relaxed); // published by the signal
            self.wake();
        }
    }

    /// Dispatcher: to be rung when the batch has been taken.
    pub(crate) fn owe(&self) {
        self.due.store(true, Ordering::Relaxed);
    }

    /// Dispatcher: rings if that is owed, since `now`, which is this moment if it is not known yet.
    pub(crate) fn pay(&self, now: &mut Option<Nanos>) {
        if self.due.load(Ordering::Relaxed) {
            self.due.store(false, Ordering::Relaxed);
            self.ring(*now.get_or_insert_with(clock::monotonic));
        }
    }

    /// Something about the worker has changed: rings also when muted.
    pub(crate) fn call(&self) {
        self.rung_at.store(clock::monotonic(), Ordering::Relaxed);
        self.wake();
    }

    fn wake(&self) {
        self.signal.set();
        if let Some(middleware) = self.relay.get() {
            middleware.wake();
        }
    }

    /// From now on it also ends the wait on the middleware.
    pub(crate) fn relay(&self, to: &Arc<dyn Middleware>) {
        self.relay.set(Arc::clone(to)).ok();
    }

    /// New data does not ring any more.
    pub(crate) fn mute(&self) {
        self.muted.store(true, Ordering::Relaxed);
    }

    /// Worker: whether it was rung since it was last answered; does not wait.
    pub(crate) fn answer(&self) -> bool {
        self.signal.take()
    }

    /// Worker: sleeps until rung, or until `release`. Returns when it became runnable.
    pub(crate) fn wait(&self, release: Option<Nanos>) -> Nanos {
        let asleep = clock::monotonic();
        let rung = match release {
            Some(at) => self.signal.wait_until(at),
            None => {
                self.signal.wait();
                true
            }
        };
        let since = match release {
            Some(at) if !rung => at,
            _ => self.rung_at.load(Ordering::Relaxed),
        };
        since.clamp(asleep, clock::monotonic().max(asleep))
    }
}
