//! `loom`'s mutex with the interface of [`PiMutex`](crate::PiMutex). Priorities are not modelled.

use crate::Nanos;
use loom::sync::Mutex;
use std::sync::{PoisonError, TryLockError};

pub use loom::sync::MutexGuard as PiMutexGuard;

/// A mutex of the model.
#[derive(Debug, Default)]
pub struct PiMutex<T>(Mutex<T>);

impl<T> PiMutex<T> {
    /// An unlocked mutex around `value`.
    pub fn new(value: T) -> Self {
        Self(Mutex::new(value))
    }

    /// Waits for the lock and takes it.
    pub fn lock(&self) -> PiMutexGuard<'_, T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The value, which no other thread can lock meanwhile.
    pub fn get_mut(&mut self) -> &mut T {
        self.0.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    /// As [`lock`](Self::lock). A deadline other than the end of time has passed as soon as the
    /// lock is found taken.
    pub fn lock_until(&self, deadline: Nanos) -> Option<PiMutexGuard<'_, T>> {
        if deadline == Nanos::MAX {
            return Some(self.lock());
        }
        let locked = self.try_lock();
        if locked.is_none() {
            loom::thread::yield_now();
        }
        locked
    }

    /// Takes the lock if it is free.
    pub fn try_lock(&self) -> Option<PiMutexGuard<'_, T>> {
        match self.0.try_lock() {
            Ok(guard) => Some(guard),
            Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }
}
