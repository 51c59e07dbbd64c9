//! A mutex with priority inheritance: `FUTEX_LOCK_PI` with a fast path of one compare-and-swap.
//!
//! The futex word, as the kernel defines it:
//!
//! ```text
//!        lock: CAS                   another thread waits: kernel sets bit 31
//!   0 ───────────────► owner's tid ───────────────────────► tid | WAITERS
//!   ▲                     │ unlock: CAS                          │ unlock: FUTEX_UNLOCK_PI
//!   └─────────────────────┘◄───────────── new owner's tid ◄──────┘ (the highest waiter)
//! ```
//!
//! While a thread waits in the kernel, the owner runs at no less than that thread's priority,
//! through chains of locks too. A middle-priority thread can therefore not keep a high one
//! waiting longer than the critical section itself.
#![expect(unsafe_code, reason = "lends out the content of an UnsafeCell")]

use super::futex;
use super::suspend;
use super::tid::current_tid;
use crate::Nanos;
use std::cell::UnsafeCell;
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicU32, Ordering};

/// A mutual exclusion lock whose owner inherits the priority of its waiters.
///
/// A worker whose low mode is suspension is not suspended while it holds one, only right after.
///
/// No poison (a panic inside a critical section unlocks it as it unwinds), no allocation, and no
/// system call while nobody else wants the lock. Waiters are served by priority, equals in order
/// of arrival. `fork` without `exec` is not supported.
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
        suspend::enter_critical();
        if !self.try_acquire() {
            self.lock_slow();
        }
        PiMutexGuard {
            mutex: self,
            not_send: PhantomData,
        }
    }

    /// As [`lock`](Self::lock), but waits no longer than until `deadline` (`CLOCK_MONOTONIC`): then
    /// `None`. Kernels before 5.14 cannot do that; there it waits as `lock` does.
    ///
    /// # Panics
    /// As [`lock`](Self::lock).
    pub fn lock_until(&self, deadline: Nanos) -> Option<PiMutexGuard<'_, T>> {
        suspend::enter_critical();
        if !self.try_acquire() {
            loop {
                match futex::lock_pi_until(&self.word, deadline) {
                    0 => break,
                    libc::EINTR | libc::EAGAIN | libc::ENOMEM => {}
                    libc::ENOSYS => {
                        self.lock_slow();
                        break;
                    }
                    error => {
                        suspend::leave_critical();
                        match error {
                            libc::ETIMEDOUT => return None,
                            error => refuse(error),
                        }
                    }
                }
            }
        }
        Some(PiMutexGuard {
            mutex: self,
            not_send: PhantomData,
        })
    }

    /// Takes the lock if it is free at this moment; never waits.
    pub fn try_lock(&self) -> Option<PiMutexGuard<'_, T>> {
        suspend::enter_critical();
        let taken = self.try_acquire();
        if !taken {
            suspend::leave_critical();
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
        let me = current_tid().get().cast_unsigned();
        self.word
            .compare_exchange(0, me, Ordering::Acquire, Ordering::Relaxed)
            .is_ok()
    }

    #[cold]
    fn lock_slow(&self) {
        loop {
            match futex::lock_pi(&self.word) {
                0 => return,
                // EAGAIN: the owner is about to exit; EINTR: the kernel restarts by itself on
                // most versions; ENOMEM: no kernel memory for the inheritance state just now.
                libc::EINTR | libc::EAGAIN | libc::ENOMEM => {}
                error => {
                    suspend::leave_critical(); // no guard will do it
                    refuse(error)
                }
            }
        }
    }

    fn unlock(&self) {
        let me = current_tid().get().cast_unsigned();
        if self
            .word
            .compare_exchange(me, 0, Ordering::Release, Ordering::Relaxed)
            .is_err()
        {
            let error = futex::unlock_pi(&self.word);
            debug_assert_eq!(error, 0, "FUTEX_UNLOCK_PI by the owner");
        }
        suspend::leave_critical();
    }
}

#[cold]
#[expect(
    clippy::panic,
    reason = "documented under # Panics: the alternative is to hang"
)]
fn refuse(error: i32) -> ! {
    match error {
        libc::EDEADLK => panic!("PiMutex: this thread holds the lock already, or a cycle of locks"),
        libc::ESRCH => panic!("PiMutex: the thread that holds the lock has ended"),
        _ => panic!(
            "PiMutex: FUTEX_LOCK_PI: {}",
            std::io::Error::from_raw_os_error(error)
        ),
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

/// The right to the content of a [`PiMutex`]; dropping it unlocks. It stays on its thread,
/// because the kernel accepts an unlock from the owner only.
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
        self.mutex.unlock();
    }
}

impl<T: ?Sized + fmt::Debug> fmt::Debug for PiMutexGuard<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}
