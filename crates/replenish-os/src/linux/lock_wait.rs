//! Waits for an enforcer's lock.
//!
//! The waits of a supervised thread are part of the enforcement, not of the callback. The thread
//! stays activated, as if it had been preempted.
//!
//! ```text
//!   thread:    since = now ── waits for the lock ── reads its records under it ── since = 0
//!   enforcer:                 reads the records: a block after `since` is a preemption
//! ```
//!
//! Counted as blocking, each wait would split the budget: the rest of it would come back later than
//! its beginning, and every further piece costs the enforcer a check.
//!
//! Any other thread tries again and again before it waits in the kernel: an unlock hands the lock
//! over to a thread that waits there, long before that thread has its CPU, and the enforcer waits
//! for both then.

use super::clock;
use super::context_switches::voluntary_switches;
use super::tid::current_tid;
use crate::pi_mutex::{PiMutex, PiMutexGuard};
use crate::{Nanos, Tid};
use std::ops::{Deref, DerefMut};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Time in nanoseconds for which a thread tries to get the lock without waiting in the kernel.
pub(crate) const PATIENCE: Nanos = 2_000_000;

/// Time in nanoseconds from one try to the next.
pub(crate) const RETRY: Nanos = 50_000;

/// Takes the lock if it is free at some moment until `deadline`.
pub(crate) fn lock_when_free<T>(
    mutex: &PiMutex<T>,
    deadline: Nanos,
) -> Option<PiMutexGuard<'_, T>> {
    loop {
        if let Some(guard) = mutex.try_lock() {
            return Some(guard);
        }
        let now = clock::monotonic();
        if now >= deadline {
            return None;
        }
        clock::sleep_until(now.saturating_add(RETRY));
    }
}

/// Takes the lock for any other thread than a supervised one at its own account.
/// Where the lock is hardly ever free, it waits in the kernel after all: it gets its turn there,
/// with priority inheritance.
pub(crate) fn lock_from_another_thread<T>(mutex: &PiMutex<T>) -> PiMutexGuard<'_, T> {
    let patience = if cfg!(loom) { 0 } else { PATIENCE };
    let deadline = clock::monotonic().saturating_add(patience);
    lock_when_free(mutex, deadline).unwrap_or_else(|| mutex.lock())
}

/// The part that the thread writes and its enforcer reads.
#[derive(Clone, Debug)]
pub(crate) struct LockWaits {
    tid: Tid,
    state: Arc<State>,
}

#[derive(Debug, Default)]
struct State {
    /// Since when it waits; 0: it does not.
    since: AtomicU64,
    /// Number of times that it blocked in all its waits, by the count of [`voluntary_switches`].
    switches: AtomicU64,
}

impl LockWaits {
    pub(crate) fn of(tid: Tid) -> Self {
        Self {
            tid,
            state: Arc::default(),
        }
    }

    /// Takes the lock from any thread. A lock that is free costs nothing more than without this.
    pub(crate) fn lock<'a, T>(&'a self, mutex: &'a PiMutex<T>) -> Locked<'a, T> {
        let (guard, waits) = match mutex.try_lock() {
            Some(guard) => (guard, None),
            None => self.wait_for(mutex),
        };
        Locked { waits, guard }
    }

    #[cold]
    fn wait_for<'a, T>(&'a self, mutex: &'a PiMutex<T>) -> (PiMutexGuard<'a, T>, Option<&'a Self>) {
        if current_tid() != self.tid {
            return (lock_from_another_thread(mutex), None);
        }
        let before = voluntary_switches();
        self.state.since.store(clock::monotonic(), Ordering::SeqCst);
        let guard = mutex.lock();
        let blocked = voluntary_switches().saturating_sub(before);
        self.state.switches.fetch_add(blocked, Ordering::Relaxed);
        (guard, Some(self))
    }

    /// Number of times that the calling thread has blocked, its waits for the lock left out.
    pub(crate) fn other_switches(&self) -> u64 {
        voluntary_switches().saturating_sub(self.state.switches.load(Ordering::Relaxed))
    }

    /// Whether a block of the thread that began at `time` belongs to such a wait.
    pub(super) fn cover(&self, time: Nanos) -> bool {
        let since = self.state.since.load(Ordering::SeqCst);
        since != 0 && time >= since
    }
}

/// The lock, held. Its holder reads the records of a thread that has waited before it lets go.
pub(crate) struct Locked<'a, T> {
    waits: Option<&'a LockWaits>,
    guard: PiMutexGuard<'a, T>,
}

impl<T> Deref for Locked<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.guard
    }
}

impl<T> DerefMut for Locked<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.guard
    }
}

impl<T> Drop for Locked<'_, T> {
    /// Under the lock still: fields are dropped afterwards.
    fn drop(&mut self) {
        if let Some(waits) = self.waits {
            waits.state.since.store(0, Ordering::SeqCst);
        }
    }
}
