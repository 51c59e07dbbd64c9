//! Counters of one handle: fixed size, written by the dispatcher and one worker. Any thread may
//! read them at any time without a lock.
//!
//! At rest, `received = executed + dropped + oversize + undecodable + discarded + waiting`, plus
//! the one whose callback panicked.

use crate::Nanos;
use crate::platform::STD;
use crate::sync::{AtomicBool, Ordering, unmodelled::AtomicU64};

/// A number that only its writers change and any thread may read.
#[derive(Debug, Default)]
pub(crate) struct Counter(AtomicU64);

impl Counter {
    /// Adds and returns the new value.
    pub(crate) fn add(&self, n: u64) -> u64 {
        self.0.fetch_add(n, Ordering::Relaxed).wrapping_add(n)
    }

    /// Adds; in place, where each message comes by.
    #[inline(always)]
    pub(crate) fn count(&self, n: u64) {
        #[cfg(target_has_atomic = "64")]
        self.0.fetch_add(n, Ordering::Relaxed);
        #[cfg(not(target_has_atomic = "64"))]
        self.0.count(n);
    }

    /// Raises the value to `n` if it is lower: rarely, so that it is looked at first, except on a
    /// small board, where a look costs as much.
    pub(crate) fn raise(&self, n: u64) {
        if !STD || n > self.get() {
            self.0.fetch_max(n, Ordering::Relaxed);
        }
    }

    pub(crate) fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// The live counters of one handle; [`HandleStats`] is a snapshot of them. The counters that each
/// message changes come first: they share a line of the cache.
#[derive(Debug, Default)]
#[repr(C)]
pub(crate) struct Counters {
    pub(crate) received: Counter,
    pub(crate) executed: Counter,
    pub(crate) cpu_high: Counter,
    pub(crate) worst_latency: Counter,
    pub(crate) worst_execution: Counter,
    pub(crate) dropped: Counter,
    pub(crate) oversize: Counter,
    pub(crate) undecodable: Counter,
    pub(crate) discarded: Counter,
    pub(crate) without_input: Counter,
    pub(crate) errors: Counter,
    pub(crate) skipped: Counter,
    pub(crate) deadline_misses: Counter,
    pub(crate) exhaustions: Counter,
    pub(crate) cpu_background: Counter,
    pub(crate) worst_lateness: Counter,
    pub(crate) panicked: AtomicBool,
}

/// Figures of one handle since the start. Times in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct HandleStats {
    /// Samples the dispatcher had for this handle.
    pub received: u64,
    /// Samples that made room for newer ones, or found none.
    pub dropped: u64,
    /// Samples larger than a slot.
    pub oversize: u64,
    /// Samples that could not be decoded.
    pub undecodable: u64,
    /// Samples discarded because the handle had stopped, or on request.
    pub discarded: u64,
    /// Samples that wait for the worker at this moment.
    pub waiting: u64,
    /// Samples the middleware itself has lost for this handle; not among `received`.
    pub lost: u64,
    /// Callbacks that ran to their end, failed ones included.
    pub executed: u64,
    /// Callbacks that ran without input, because they run in every round.
    pub without_input: u64,
    /// Callbacks that returned an error.
    pub errors: u64,
    /// Whether a callback panicked; the handle has stopped then.
    pub panicked: bool,
    /// Timer releases left out because they were overrun, triggers of a guard condition that were
    /// served together with an earlier one.
    pub skipped: u64,
    /// Callbacks that ended after their deadline; a timer's is its next release, if no other is
    /// given.
    pub deadline_misses: u64,
    /// Budget exhaustions while a callback of this handle ran.
    pub exhaustions: u64,
    /// CPU time of the callbacks at the worker's own priority. Without a budget, callbacks that
    /// take less than 20 us are read sixteen at a time: each is charged its duration and an equal
    /// part of the rest, and the sum is what the thread has used.
    pub cpu_high: Nanos,
    /// CPU time of the callbacks at background priority.
    pub cpu_background: Nanos,
    /// Longest time from arrival (timer: release) to the start of the callback.
    pub worst_latency: Nanos,
    /// Most CPU time that one callback took; shares of brief ones as in `cpu_high`.
    pub worst_execution: Nanos,
    /// The furthest a callback ended behind its deadline.
    pub worst_lateness: Nanos,
}

impl Counters {
    pub(crate) fn snapshot(&self, waiting: u64, lost: u64) -> HandleStats {
        HandleStats {
            received: self.received.get(),
            dropped: self.dropped.get(),
            oversize: self.oversize.get(),
            undecodable: self.undecodable.get(),
            discarded: self.discarded.get(),
            waiting,
            lost,
            executed: self.executed.get(),
            without_input: self.without_input.get(),
            errors: self.errors.get(),
            panicked: self.panicked.load(Ordering::Relaxed),
            skipped: self.skipped.get(),
            deadline_misses: self.deadline_misses.get(),
            exhaustions: self.exhaustions.get(),
            cpu_high: self.cpu_high.get(),
            cpu_background: self.cpu_background.get(),
            worst_latency: self.worst_latency.get(),
            worst_execution: self.worst_execution.get(),
            worst_lateness: self.worst_lateness.get(),
        }
    }
}
