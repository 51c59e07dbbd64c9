//! A receiver of messages, and what it counts.

use super::threads::Used;
use crate::load::Nanos;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_os::clock;
use std::sync::atomic::{AtomicU64, Ordering};

/// Settings that all windows of a run have in common, and the number of windows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Setting {
    pub(super) rate: u64,
    pub(super) windows: u64,
    pub(super) cpu: usize,
    pub(super) support: usize,
    pub(super) awake: bool,
}

/// Messages received in a window: noted by the receiver, read when the window is over.
#[derive(Debug)]
pub(super) struct Received {
    times: Box<[AtomicU64]>,
    count: AtomicU64,
}

impl Received {
    pub(super) fn new(rate: u64) -> Self {
        let room = usize::try_from(2 * rate).unwrap_or(usize::MAX);
        Self {
            times: (0..room).map(|_| AtomicU64::new(0)).collect(),
            count: AtomicU64::new(0),
        }
    }

    /// A message that was sent at `sent` is here.
    pub(super) fn note(&self, sent: Nanos) {
        let took = clock::monotonic().saturating_sub(sent);
        let n = self.count.fetch_add(1, Ordering::Relaxed);
        let slot = usize::try_from(n).ok().and_then(|n| self.times.get(n));
        if let Some(slot) = slot {
            slot.store(took, Ordering::Relaxed);
        }
    }

    /// The times so far; from now on anew.
    pub(super) fn take(&self) -> Vec<i64> {
        let n = usize::try_from(self.count.swap(0, Ordering::AcqRel)).unwrap_or(usize::MAX);
        let times = self.times.iter().take(n);
        times
            .map(|t| i64::try_from(t.load(Ordering::Relaxed)).unwrap_or(i64::MAX))
            .collect()
    }
}

/// One of the compared receivers.
pub(super) trait Receiver {
    /// Sends message `n`; what it carries is the time before its sending.
    fn send(&mut self, n: u64) -> Outcome;

    /// The messages that have come, and the time that each took.
    fn received(&self) -> &Received;

    /// CPU time and voluntary context switches of its threads so far.
    fn used(&self) -> Result<Used, Failure>;
}
