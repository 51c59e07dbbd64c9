//! A supervised task's waits for its enforcer's lock.

use crate::backend::voluntary_switches;
use crate::pi_mutex::{PiMutex, PiMutexGuard};

/// Takes the lock for any other task than a supervised one at its own account.
pub(crate) fn lock_from_another_thread<T>(mutex: &PiMutex<T>) -> PiMutexGuard<'_, T> {
    mutex.lock()
}

/// A task waits for its enforcer's lock while another on the one CPU holds it: seldom and briefly.
/// Its waits count as blocking.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LockWaits;

impl LockWaits {
    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) fn lock<'a, T>(&self, mutex: &'a PiMutex<T>) -> PiMutexGuard<'a, T> {
        mutex.lock()
    }

    #[expect(clippy::unused_self, reason = "the other back end's name")]
    pub(crate) fn other_switches(&self) -> u64 {
        voluntary_switches()
    }
}
