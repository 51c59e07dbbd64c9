//! The bell on which a worker sleeps. Any thread rings it; it remembers the instant.
//!
//! ```text
//!            ring, force                      take, or wait returns
//!   silent ──────────────► rung (since when) ──────────────────────► silent
//!      │                      ▲
//!      └── defer ──► due ── flush     the dispatcher rings once for a whole batch
//!
//!   mute: from then on ring and flush do nothing, force still rings
//! ```
//!
//! A budget comes back one period after the worker became *runnable*: when its bell rang or its
//! timer's release came, not when it got the CPU. An instant that is too late only delays a
//! replenishment; one that is too early would advance it. So the instant is never before the worker
//! went to sleep.
//!
//! An executor without threads waits on its middleware alone. Its bell is *forwarded*: it ends that
//! wait too ([`Wake`]), by an atomic operation and one system call at most.
//!
//! A worker whose rounds come by the clock alone has its bell *muted*.

use crate::ReadySet;
use crate::sync::{Arc, AtomicBool, AtomicU64, Notify, Once, Ordering};
use replenish_os::{Nanos, clock};

/// The end of a worker's sleep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Woken {
    /// When the worker became runnable.
    pub since: Nanos,
    /// When its wait returned: later if it had to wait for the CPU.
    pub awake: Nanos,
}

/// A middleware that a worker waits on instead of its bell.
pub trait Wake {
    /// Ends the current wait, or the next one. Async-signal-safe.
    fn wake(&self);
}

/// The way of one handle's input to its worker: the bell, and the mark that says which handle.
pub struct WakeHandle<W: ?Sized> {
    bell: Arc<Doorbell<W>>,
    slot: usize,
}

impl<W: ?Sized> Clone for WakeHandle<W> {
    fn clone(&self) -> Self {
        Self::new(&self.bell, self.slot)
    }
}

impl<W: ?Sized> WakeHandle<W> {
    /// For the handle in `slot` of the worker that sleeps on `bell`.
    #[must_use]
    pub fn new(bell: &Arc<Doorbell<W>>, slot: usize) -> Self {
        let bell = Arc::clone(bell);
        Self { bell, slot }
    }

    /// The bell.
    #[must_use]
    pub fn bell(&self) -> &Arc<Doorbell<W>> {
        &self.bell
    }

    /// There is input for the handle, and the bell is yet to ring. Async-signal-safe.
    #[inline]
    pub fn mark(&self) {
        self.bell.marks.mark(self.slot);
    }

    /// Dispatcher: the bell rings when the batch has been taken.
    #[inline]
    pub fn defer(&self) {
        self.bell.due.store(true, Ordering::Relaxed);
    }
}

impl<W: Wake + ?Sized> WakeHandle<W> {
    /// There is input for the handle, since `now`. Async-signal-safe.
    pub fn ring(&self, now: Nanos) {
        self.mark();
        self.bell.ring(now);
    }

    /// Something about the handle has changed: rings also when muted.
    pub fn force(&self) {
        self.mark();
        self.bell.force();
    }
}

/// Rung by the dispatcher, by a handle or by a stop; one worker sleeps on it.
pub struct Doorbell<W: ?Sized> {
    notify: Arc<Notify>,
    rung_at: AtomicU64,
    muted: AtomicBool,
    /// The dispatcher has brought input and is yet to ring.
    due: AtomicBool,
    marks: ReadySet,
    /// The bell of the thread that runs the worker, if it has no thread of its own.
    forward: Once<Arc<W>>,
}

impl<W: ?Sized> Doorbell<W> {
    /// For a worker with handles in slots below `slots`.
    #[must_use]
    pub fn new(slots: usize) -> Self {
        Self {
            notify: Arc::new(Notify::new()),
            rung_at: AtomicU64::new(0),
            muted: AtomicBool::new(false),
            due: AtomicBool::new(false),
            marks: ReadySet::new(slots),
            forward: Once::new(),
        }
    }

    /// The cell below, for threads that do not bring work.
    #[must_use]
    pub const fn notify(&self) -> &Arc<Notify> {
        &self.notify
    }

    /// The handles whose input has come.
    #[inline]
    #[must_use]
    pub const fn marks(&self) -> &ReadySet {
        &self.marks
    }

    /// From now on it also ends waits on `other`.
    pub fn forward_to(&self, other: &Arc<W>) {
        self.forward.set(Arc::clone(other)).ok();
    }

    /// New data does not ring any more.
    pub fn mute(&self) {
        self.muted.store(true, Ordering::Relaxed);
    }

    /// Worker: whether it rang since the last `take`; does not wait.
    pub fn take(&self) -> bool {
        self.notify.take()
    }

    /// Worker: sleeps until it rings, or until `release`.
    pub fn wait(&self, release: Option<Nanos>) -> Woken {
        let asleep = clock::monotonic();
        let rung = match release {
            Some(at) => self.notify.wait_until(at),
            None => {
                self.notify.wait();
                true
            }
        };
        let since = match release {
            Some(at) if !rung => at,
            _ => self.rung_at.load(Ordering::Relaxed),
        };
        let awake = clock::monotonic().max(asleep);
        Woken {
            since: since.clamp(asleep, awake),
            awake,
        }
    }
}

#[cfg(feature = "std")]
impl<W: ?Sized> Doorbell<W> {
    /// Worker: as [`wait`](Self::wait), in `sleep`, which waits for descriptors as well: until one
    /// is readable, or that of the [cell](Self::notify), or until `release`.
    pub fn wait_elsewhere(&self, release: Option<Nanos>, sleep: impl FnOnce()) -> Woken {
        let asleep = clock::monotonic();
        let (rung, _) = self.notify.wait_elsewhere(sleep);
        let awake = clock::monotonic().max(asleep);
        let since = if rung {
            self.rung_at.load(Ordering::Relaxed)
        } else {
            release.map_or(awake, |at| at.min(awake))
        };
        Woken {
            since: since.clamp(asleep, awake),
            awake,
        }
    }
}

impl<W: Wake + ?Sized> Doorbell<W> {
    /// There is work, since `now`. Async-signal-safe.
    pub fn ring(&self, now: Nanos) {
        if !self.muted.load(Ordering::Relaxed) {
            self.rung_at.store(now, Ordering::Relaxed); // published by the cell
            self.wake();
        }
    }

    /// Dispatcher: rings if that was deferred, since `now`, which is read if it is not known yet.
    #[inline]
    pub fn flush(&self, now: &mut Option<Nanos>) {
        if self.due.load(Ordering::Relaxed) {
            self.due.store(false, Ordering::Relaxed);
            self.ring(*now.get_or_insert_with(clock::monotonic));
        }
    }

    /// Something about the worker has changed: rings also when muted.
    pub fn force(&self) {
        self.rung_at.store(clock::monotonic(), Ordering::Relaxed);
        self.wake();
    }

    fn wake(&self) {
        self.notify.set();
        if let Some(other) = self.forward.get() {
            other.wake();
        }
    }
}
