//! A mutex with priority inheritance: a word that names the owner, and the content.
//!
//! The word is the back end's (`backend::pi_lock`): of `FUTEX_LOCK_PI` on Linux, ours elsewhere.
#![expect(unsafe_code, reason = "lends out the content of an UnsafeCell")]

use crate::Nanos;
use crate::backend::pi_lock;
use core::cell::UnsafeCell;
use core::fmt;
use core::marker::PhantomData;
use core::ops::{Deref, DerefMut};
use core::sync::atomic::AtomicU32;

/// A mutual exclusion lock whose owner inherits the priority of its waiters, through chains too.
///
/// A middle-priority thread can therefore not keep a high one waiting longer than the critical
/// section itself.
///
/// A worker whose low mode is suspension is not stopped while it holds one. On Linux it goes on in
/// the time-sharing class, or at the priority of a waiter, and is stopped as it leaves its last
/// critical section; under FreeRTOS it goes on as soon as another task waits, at that task's
/// priority. On Linux that time is charged to its budget, and so is the time in which a worker in
/// the background holds a lock that others wait for: between two replenishments it inherits less
/// than its budget and one section. `docs/enforcement.md` has the rules.
///
/// No poison (a panic that unwinds out of a critical section unlocks it), no allocation, and no
/// system call while no other thread wants the lock. Waiters are served by priority, equals in
/// order of arrival. Threads only, no interrupts. `fork` without `exec` is not supported.
pub struct PiMutex<T: ?Sized> {
    word: AtomicU32,
    data: UnsafeCell<T>,
}

// SAFETY: the lock gives one thread at a time access to the data, which may move between threads.
unsafe impl<T: ?Sized + Send> Sync for PiMutex<T> {}

impl<T> PiMutex<T> {
    /// An unlocked mutex around `value`.
    pub const fn new(value: T) -> Self {
        Self {
            word: AtomicU32::new(0),
            data: UnsafeCell::new(value),
        }
    }

    /// The content.
    pub fn into_inner(self) -> T {
        self.data.into_inner()
    }
}

impl<T: ?Sized> PiMutex<T> {
    /// Waits for the lock and takes it.
    ///
    /// # Panics
    /// If the calling thread holds the lock already, if the thread that holds it has ended
    /// without unlocking (a leaked guard), or if the kernel has no priority-inheriting futexes.
    /// The alternative to each would be to wait for ever.
    pub fn lock(&self) -> PiMutexGuard<'_, T> {
        pi_lock::lock(&self.word);
        self.guard()
    }

    /// As [`lock`](Self::lock), but waits no longer than until `deadline`
    /// ([`monotonic`](crate::clock::monotonic) time): then `None`, and the owner no longer has this
    /// thread's priority. Linux before 5.14 cannot do that; there it waits as `lock` does.
    ///
    /// # Panics
    /// As [`lock`](Self::lock).
    pub fn lock_until(&self, deadline: Nanos) -> Option<PiMutexGuard<'_, T>> {
        // Lazily: a guard that is built unlocks when it is dropped.
        pi_lock::lock_until(&self.word, deadline).then(|| self.guard())
    }

    /// Takes the lock if it is free at this moment; never waits. On Linux a lock is free, too, that
    /// was handed over to a less urgent thread which has not run since.
    pub fn try_lock(&self) -> Option<PiMutexGuard<'_, T>> {
        pi_lock::try_lock(&self.word).then(|| self.guard())
    }

    /// The thread that holds the lock at this moment, if any does.
    #[cfg(all(target_os = "linux", not(nuttx_host)))]
    pub(crate) fn owner(&self) -> Option<crate::Tid> {
        pi_lock::owner(&self.word)
    }

    /// Whether a thread waits for the lock in the kernel at this moment.
    #[cfg(all(test, target_os = "linux", not(nuttx_host)))]
    pub(crate) fn is_awaited(&self) -> bool {
        self.word.load(core::sync::atomic::Ordering::SeqCst) & pi_lock::WAITERS != 0
    }

    /// The content, without locking: `&mut self` proves that no other thread has it.
    pub fn get_mut(&mut self) -> &mut T {
        self.data.get_mut()
    }

    /// The guard of a lock that was just taken.
    const fn guard(&self) -> PiMutexGuard<'_, T> {
        PiMutexGuard {
            mutex: self,
            not_send: PhantomData,
        }
    }
}

impl<T: Default> Default for PiMutex<T> {
    fn default() -> Self {
        Self::new(T::default())
    }
}

impl<T: ?Sized + fmt::Debug> fmt::Debug for PiMutex<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.try_lock() {
            Some(guard) => f.debug_tuple("PiMutex").field(&&*guard).finish(),
            None => f.write_str("PiMutex(<locked>)"),
        }
    }
}

/// The right to the content of a [`PiMutex`]; dropping it unlocks. It stays on its thread, because
/// only the owner may unlock.
#[must_use = "the lock is released as soon as the guard is dropped"]
pub struct PiMutexGuard<'a, T: ?Sized> {
    mutex: &'a PiMutex<T>,
    not_send: PhantomData<*const ()>,
}

// SAFETY: sharing a guard shares only `&T`.
unsafe impl<T: ?Sized + Sync> Sync for PiMutexGuard<'_, T> {}

impl<T: ?Sized> Deref for PiMutexGuard<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        // SAFETY: the guard exists, so this thread holds the lock.
        unsafe { &*self.mutex.data.get() }
    }
}

impl<T: ?Sized> DerefMut for PiMutexGuard<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: the guard exists and is borrowed mutably, so this is the only access.
        unsafe { &mut *self.mutex.data.get() }
    }
}

impl<T: ?Sized> Drop for PiMutexGuard<'_, T> {
    fn drop(&mut self) {
        pi_lock::unlock(&self.mutex.word);
    }
}

impl<T: ?Sized + fmt::Debug> fmt::Debug for PiMutexGuard<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}
