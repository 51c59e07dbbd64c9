//! The synchronisation the hand-off is built from, behind one name each: the operating system's in
//! a normal build, `loom`'s in a model (`--cfg loom`), so that the models run the real code.
//!
//! Everything in `handoff/` uses these names and nothing else of the operating system.

#[cfg(all(not(loom), target_has_atomic = "64"))]
pub use core::sync::atomic::AtomicU64;
#[cfg(not(loom))]
pub use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering, fence};
#[cfg(all(not(loom), not(target_has_atomic = "64")))]
pub use replenish_os::AtomicU64;
#[cfg(not(loom))]
pub use replenish_os::{Arc, Notify, PiMutex as Mutex};

#[cfg(loom)]
pub use loom::sync::{
    Arc,
    atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering, fence},
};
#[cfg(loom)]
pub use model::{Mutex, Notify};

#[cfg(loom)]
mod model {
    use loom::sync::{Condvar, MutexGuard};

    /// `loom`'s mutex with the interface of `replenish_os::PiMutex`.
    pub struct Mutex<T>(loom::sync::Mutex<T>);

    impl<T> Mutex<T> {
        pub fn new(value: T) -> Self {
            Self(loom::sync::Mutex::new(value))
        }

        pub fn lock(&self) -> MutexGuard<'_, T> {
            self.0.lock().unwrap()
        }

        /// Any deadline but the end of time has come when the lock is not free.
        pub fn lock_until(&self, deadline: u64) -> Option<MutexGuard<'_, T>> {
            if deadline == u64::MAX {
                return Some(self.lock());
            }
            let locked = self.0.try_lock().ok();
            if locked.is_none() {
                loom::thread::yield_now();
            }
            locked
        }
    }

    impl<T: Default> Default for Mutex<T> {
        fn default() -> Self {
            Self::new(T::default())
        }
    }

    /// The contract of `replenish_os::Notify`: sticky, one waiter. (Its own futex protocol has its
    /// own models in that crate.)
    pub struct Notify {
        set: loom::sync::Mutex<bool>,
        changed: Condvar,
    }

    impl Default for Notify {
        fn default() -> Self {
            Self::new()
        }
    }

    impl Notify {
        pub fn new() -> Self {
            Self {
                set: loom::sync::Mutex::new(false),
                changed: Condvar::new(),
            }
        }

        pub fn set(&self) {
            *self.set.lock().unwrap() = true;
            self.changed.notify_one();
        }

        pub fn wait(&self) {
            let mut set = self.set.lock().unwrap();
            while !*set {
                set = self.changed.wait(set).unwrap();
            }
            *set = false;
        }

        pub fn take(&self) -> bool {
            core::mem::take(&mut *self.set.lock().unwrap())
        }

        /// The deadline never comes: who needs it to go on is asleep for ever.
        pub fn wait_until(&self, _: u64) -> bool {
            self.wait();
            true
        }
    }
}
