//! What a worker sleeps on: a signal, and when it was given.
//!
//! A budget comes back one period after the worker became *runnable*, which is when its bell was
//! rung or its timer's release came, not when it got the CPU. Taking a time that is too late only
//! delays a replenishment; one that is too early would advance it, so it is never before the
//! moment the worker went to sleep.

use crate::Nanos;
use crate::sync::{Arc, Signal};
use core::sync::atomic::{AtomicU64, Ordering};
use replenish_os::clock;

/// Rung by the dispatcher or by a stop; one worker sleeps on it.
#[derive(Default)]
pub(crate) struct Doorbell {
    signal: Arc<Signal>,
    rung_at: AtomicU64,
}

impl Doorbell {
    /// The signal alone, for those who do not bring work.
    pub(crate) fn signal(&self) -> &Arc<Signal> {
        &self.signal
    }

    /// There is work, since `now`.
    pub(crate) fn ring(&self, now: Nanos) {
        self.rung_at.store(now, Ordering::Relaxed); // published by the signal
        self.signal.set();
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
