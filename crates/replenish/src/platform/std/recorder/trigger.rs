//! Asking for a dump from a thread that must not wait.
//!
//! ```text
//!            fire: the first cause stays         dumper: take
//!   quiet ──────────────────────────────► fired ──────────────► quiet
//!                                           │ fire: the same dump
//!                                           └────────────────────
//! ```

use super::dump::Dump;
use crate::Nanos;
use replenish_os::Notify;
use replenish_recorder::Span;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The reason of a dump.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cause {
    Miss = 1,
    Overrun = 2,
    Panic = 3,
    Stop = 4,
}

impl Cause {
    const ALL: [Self; 4] = [Self::Miss, Self::Overrun, Self::Panic, Self::Stop];

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Miss => "miss",
            Self::Overrun => "overrun",
            Self::Panic => "panic",
            Self::Stop => "stop",
        }
    }
}

/// The word that threads set and the dumper takes: `fire` costs an exchange, and the dumper's
/// wake-up if it sleeps.
#[derive(Debug)]
pub(super) struct Armed {
    miss: bool,
    panic: bool,
    /// A callback that takes longer is an overrun.
    pub(super) bound: Nanos,
    /// 0, or the number of a cause.
    cause: AtomicU64,
    /// The first word of the ring, and the records in it at that time.
    ring: AtomicU64,
    written: AtomicU64,
    pub(super) notify: Notify,
    /// The executor has ended.
    pub(super) ended: AtomicBool,
}

impl Armed {
    pub(super) fn new(dump: &Dump) -> Self {
        let bound = dump.overrun.map(|bound| bound.as_nanos());
        Self {
            miss: dump.miss,
            panic: dump.panic,
            bound: bound.map_or(Nanos::MAX, |b| u64::try_from(b).unwrap_or(Nanos::MAX)),
            cause: AtomicU64::new(0),
            ring: AtomicU64::new(0),
            written: AtomicU64::new(0),
            notify: Notify::new(),
            ended: AtomicBool::new(false),
        }
    }

    /// Something went wrong on the thread of this ring. Does not wait.
    pub(super) fn fire(&self, cause: Cause, ring: Span, written: u64) {
        let wanted = match cause {
            Cause::Miss => self.miss,
            Cause::Panic => self.panic,
            Cause::Overrun | Cause::Stop => true,
        };
        let (quiet, fired) = (Ordering::Relaxed, Ordering::AcqRel);
        let fire = || self.cause.compare_exchange(0, cause as u64, fired, quiet);
        if wanted && fire().is_ok() {
            self.ring.store(ring.start as u64, Ordering::Relaxed);
            self.written.store(written, Ordering::Relaxed);
            self.notify.set();
        }
    }

    /// The cause that was fired, if there is one; it stays until [`rearm`](Self::rearm).
    pub(super) fn fired(&self) -> Option<Cause> {
        let number = self.cause.load(Ordering::Acquire);
        Cause::ALL.into_iter().find(|c| *c as u64 == number)
    }

    /// Position of the cause: the ring's first word, and the ring's number of records then.
    pub(super) fn at(&self) -> (u64, u64) {
        let [ring, written] = [&self.ring, &self.written].map(|w| w.load(Ordering::Relaxed));
        (ring, written)
    }

    /// Clears the cause: the next one is for another dump.
    pub(super) fn rearm(&self) {
        self.cause.store(0, Ordering::Release);
    }
}
