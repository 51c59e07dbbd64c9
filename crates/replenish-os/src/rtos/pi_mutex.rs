//! A mutex with priority inheritance. The kernel's inheritance, our word and queue: the kernel's
//! own mutex must not move in memory, ours may.
//!
//! ```text
//!        lock: CAS                another task waits: it sets bit 31
//!   0 ───────────────► owner ───────────────────────────► owner | WAITERS
//!   ▲                    │ unlock: CAS                       │ unlock, masked
//!   └────────────────────┘◄───────────── the highest waiter ◄┘
//! ```
//!
//! A waiter raises the owner to its own priority (`xTaskPriorityInherit`), and the owner keeps that
//! until it holds no mutex any more. The kernel does not pass a boost on along a chain of locks.
#![expect(unsafe_code, reason = "lends out the content of an UnsafeCell")]

use super::ffi;
use super::futex;
use super::slot;
use super::tid::current_tid;
use crate::Nanos;
use core::cell::UnsafeCell;
use core::fmt;
use core::marker::PhantomData;
use core::ops::{Deref, DerefMut};
use core::sync::atomic::{AtomicU32, Ordering};

const WAITERS: u32 = 1 << 31;

/// A mutual exclusion lock whose owner inherits the priority of its waiters. From tasks only.
///
/// A worker that is suspended for want of budget while it holds one goes on as soon as somebody
/// waits for it, at that task's priority. No allocation; waiters are served by priority.
pub struct PiMutex<T: ?Sized> {
    word: AtomicU32,
    data: UnsafeCell<T>,
}

// SAFETY: the lock gives one task at a time access to the data, which may move between tasks.
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

fn me() -> u32 {
    current_tid().get().cast_unsigned()
}

impl<T: ?Sized> PiMutex<T> {
    /// Waits for the lock and takes it.
    ///
    /// # Panics
    /// If the calling task holds the lock already, or if the task that holds it has ended without
    /// unlocking (a leaked guard): the alternative would be to wait for ever.
    pub fn lock(&self) -> PiMutexGuard<'_, T> {
        if !self.try_acquire() {
            self.lock_slow(None);
        }
        if slot::current().is_some() {
            ffi::held();
        }
        PiMutexGuard {
            mutex: self,
            not_send: PhantomData,
        }
    }

    /// As [`lock`](Self::lock), but waits no longer than until `deadline`: then `None`. What the
    /// owner inherited meanwhile it keeps until it unlocks.
    ///
    /// # Panics
    /// As [`lock`](Self::lock).
    pub fn lock_until(&self, deadline: Nanos) -> Option<PiMutexGuard<'_, T>> {
        let taken = self.try_acquire() || self.lock_slow(Some(deadline));
        if taken && slot::current().is_some() {
            ffi::held();
        }
        // Lazily: a guard that is built unlocks when it is dropped.
        taken.then(|| PiMutexGuard {
            mutex: self,
            not_send: PhantomData,
        })
    }

    /// Takes the lock if it is free at this moment; never waits.
    pub fn try_lock(&self) -> Option<PiMutexGuard<'_, T>> {
        let taken = self.try_acquire();
        if taken && slot::current().is_some() {
            ffi::held();
        }
        // Lazily: a guard that is built unlocks when it is dropped.
        taken.then(|| PiMutexGuard {
            mutex: self,
            not_send: PhantomData,
        })
    }

    /// The content, without locking: `&mut self` proves that nobody else has it.
    pub fn get_mut(&mut self) -> &mut T {
        self.data.get_mut()
    }

    fn try_acquire(&self) -> bool {
        self.word
            .compare_exchange(0, me(), Ordering::Acquire, Ordering::Relaxed)
            .is_ok()
    }

    /// Whether the lock was taken before the deadline.
    #[cold]
    fn lock_slow(&self, deadline: Option<Nanos>) -> bool {
        let me = me();
        let mut waits = false;
        loop {
            let before = ffi::mask();
            let word = self.word.load(Ordering::Acquire);
            let owner = word & !WAITERS;
            let mine = if owner == 0 {
                self.word.store(me | word & WAITERS, Ordering::Release);
                true
            } else {
                // Handed over by the unlock, while it slept.
                waits && owner == me
            };
            if mine || owner == me {
                ffi::unmask(before);
                assert!(mine, "PiMutex: this task holds the lock already");
                return true;
            }
            if deadline.is_some_and(|t| ffi::board_now() >= t) {
                // A waiters' bit without waiters costs the owner a look.
                ffi::unmask(before);
                return false;
            }
            let (ended, task) = slot::find(owner.cast_signed())
                .map_or((false, None), |s| s.state.with(|s| (s.ended, s.task)));
            if ended {
                ffi::unmask(before);
                assert!(!ended, "PiMutex: the task that holds the lock has ended");
            }
            self.word.store(word | WAITERS, Ordering::Release);
            if let Some(owner) = task {
                ffi::inherit(owner);
            }
            let expected = word | WAITERS;
            waits = true;
            // Still masked: the owner cannot give it back before this task is on the list.
            futex::wait_masked(&self.word, expected, deadline, before);
        }
    }

    fn unlock(&self) {
        if slot::current().is_none() {
            self.word.store(0, Ordering::Release);
            return;
        }
        let before = ffi::mask();
        let mut next = None;
        if self.word.load(Ordering::Relaxed) & WAITERS != 0 {
            next = futex::take_waiter(&self.word);
        }
        let word = next.map_or(0, |slot| {
            let more = if futex::has_waiter(&self.word) {
                WAITERS
            } else {
                0
            };
            slot.id.cast_unsigned() | more
        });
        self.word.store(word, Ordering::Release);
        let lowered = ffi::disinherit();
        ffi::unmask(before);
        if let Some(task) = next.and_then(|slot| slot.state.with(|s| s.task)) {
            ffi::wake(task);
        }
        if lowered {
            ffi::yield_now();
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

/// The right to the content of a [`PiMutex`]; dropping it unlocks. It stays on its task.
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
        // SAFETY: the guard exists, so this task holds the lock.
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
        self.mutex.unlock();
    }
}

impl<T: ?Sized + fmt::Debug> fmt::Debug for PiMutexGuard<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}
