//! Asking for a dump from a thread that must not wait, and holding its ring until it is copied.
//!
//! ```text
//!            fire: the first cause stays          dumper: copied           written, or left out
//!   quiet ──────────────────────────────► fired ─────────────────► copied ──────────────────► quiet
//!                                           │ the ring of the thread that fired is full:
//!                                           └ it leaves events out, and counts them
//! ```
//!
//! One word has the state and the number of the dump, so that a thread which was held up in between
//! never takes another dump for its own.

use super::dump::Dump;
use crate::Nanos;
use replenish_os::Notify;
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

/// The bits of the state below the number of the dump.
const STATE: u64 = 0xff;
/// Beside the cause: the recording is copied.
const COPIED: u64 = 0x10;

/// A dump that was asked for: its number, and its cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Fired(u64);

impl Fired {
    pub(super) fn cause(self) -> Option<Cause> {
        let number = self.0 & STATE;
        Cause::ALL.into_iter().find(|c| *c as u64 == number)
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
    state: AtomicU64,
    /// The dump whose thread has filled the half of its ring that comes after the trigger.
    full: AtomicU64,
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
            state: AtomicU64::new(0),
            full: AtomicU64::new(0),
            notify: Notify::new(),
            ended: AtomicBool::new(false),
        }
    }

    /// Something went wrong on the calling thread. Does not wait. If no other dump is under way,
    /// the thread keeps what its ring holds until the dump [is copied](Self::is_copied).
    pub(super) fn fire(&self, cause: Cause) -> Option<Fired> {
        let wanted = match cause {
            Cause::Miss => self.miss,
            Cause::Panic => self.panic,
            Cause::Overrun | Cause::Stop => true,
        };
        let now = self.state.load(Ordering::Relaxed);
        if !wanted || now & STATE != 0 {
            return None;
        }
        let next = (now | STATE).wrapping_add(1) | cause as u64;
        self.state
            .compare_exchange(now, next, Ordering::AcqRel, Ordering::Relaxed)
            .ok()?;
        self.notify.set();
        Some(Fired(next))
    }

    /// The ring of the thread that asked for this dump is full. Does not wait.
    #[cold]
    pub(super) fn fill(&self, fired: Fired) {
        self.full.store(fired.0, Ordering::Release);
        self.notify.set();
    }

    /// Whether the thread that asked for this dump may go on.
    pub(super) fn is_copied(&self, fired: Fired) -> bool {
        self.state.load(Ordering::Acquire) != fired.0
    }

    /// The dump that was asked for, if there is one.
    pub(super) fn fired(&self) -> Option<Fired> {
        let fired = Fired(self.state.load(Ordering::Acquire));
        fired.cause().map(|_| fired)
    }

    /// Whether its thread has nothing to add.
    pub(super) fn is_full(&self, fired: Fired) -> bool {
        self.full.load(Ordering::Acquire) == fired.0
    }

    /// The recording is copied, or is not going to be.
    pub(super) fn copied(&self, fired: Fired) {
        self.state.store(fired.0 | COPIED, Ordering::Release);
    }

    /// The next cause is another dump's.
    pub(super) fn rearm(&self, fired: Fired) {
        self.state.store(fired.0 & !STATE, Ordering::Release);
    }
}
