//! A mutex with priority inheritance: a word, and the slots of those who wait for it.
//!
//! ```text
//!        lock: CAS                another task waits: it sets bit 31
//!   0 ───────────────► owner ───────────────────────────► owner | WAITERS
//!   ▲                    │ unlock: CAS                       │ unlock, masked
//!   └────────────────────┘◄───────────── the highest waiter ◄┘
//! ```
//!
//! A waiter lends the owner its priority (`inherit`), through chains of locks, until the owner has
//! given the lock back.
#![expect(unsafe_code, reason = "lends out the content of an UnsafeCell")]

use super::ffi;
use super::futex;
use super::inherit;
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
        PiMutexGuard {
            mutex: self,
            not_send: PhantomData,
        }
    }

    /// As [`lock`](Self::lock), but waits no longer than until `deadline`
    /// ([`monotonic`](crate::clock::monotonic) time): then `None`, and the owner no longer has this
    /// task's priority.
    ///
    /// # Panics
    /// As [`lock`](Self::lock).
    pub fn lock_until(&self, deadline: Nanos) -> Option<PiMutexGuard<'_, T>> {
        let taken = self.try_acquire() || self.lock_slow(Some(deadline));
        taken.then(|| PiMutexGuard {
            mutex: self,
            not_send: PhantomData,
        })
    }

    /// Takes the lock if it is free at this moment; never waits.
    pub fn try_lock(&self) -> Option<PiMutexGuard<'_, T>> {
        // Lazily: a guard that is built unlocks when it is dropped.
        self.try_acquire().then(|| PiMutexGuard {
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

    /// Waits; whether it has the lock, which it has if there is no deadline.
    #[cold]
    fn lock_slow(&self, deadline: Option<Nanos>) -> bool {
        let me = me();
        let mut waits = false;
        loop {
            let before = ffi::mask();
            let word = self.word.load(Ordering::Acquire);
            let owner = word & !WAITERS;
            let mine = if owner == 0 {
                self.swap(word, me)
            } else {
                // Handed over by the unlock, while it slept.
                waits && owner == me
            };
            if mine || owner == me {
                ffi::unmask(before);
                assert!(mine, "PiMutex: this task holds the lock already");
                return true;
            }
            let holder = slot::find(owner.cast_signed());
            let ended = holder.is_some_and(|s| s.state.with(|s| s.ended));
            if ended {
                ffi::unmask(before);
                assert!(!ended, "PiMutex: the task that holds the lock has ended");
            }
            // The mark for waiters may stay: the unlock finds that there is none.
            if deadline.is_some_and(|t| ffi::board_now() >= t) {
                if let Some(holder) = holder {
                    inherit::withdraw(holder);
                }
                ffi::unmask(before);
                return false;
            }
            // Taken or given back between the reading and now: look again.
            let expected = word | WAITERS;
            if owner == 0 || !self.swap(word, expected) {
                ffi::unmask(before);
                continue;
            }
            if let Some(holder) = holder {
                inherit::lend(holder);
            }
            waits = true;
            // Still masked: the owner cannot give it back before this task is on the list.
            futex::wait_masked(&self.word, expected, deadline, before);
        }
    }

    fn swap(&self, from: u32, to: u32) -> bool {
        self.word
            .compare_exchange(from, to, Ordering::AcqRel, Ordering::Relaxed)
            .is_ok()
    }

    fn unlock(&self) {
        if self.swap(me(), 0) {
            return; // nobody waits
        }
        self.unlock_slow();
    }

    /// Hands the lock to the highest of those who wait.
    #[cold]
    fn unlock_slow(&self) {
        let before = ffi::mask();
        let next = futex::take_waiter(&self.word);
        let word = next.map_or(0, |slot| {
            let more = if futex::has_waiter(&self.word) {
                WAITERS
            } else {
                0
            };
            slot.id.cast_unsigned() | more
        });
        self.word.store(word, Ordering::Release);
        let boosted = inherit::is_boosted();
        ffi::unmask(before);
        if let Some(task) = next.and_then(|slot| slot.state.with(|s| s.task)) {
            ffi::wake(task);
        }
        if boosted {
            inherit::give_back();
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
