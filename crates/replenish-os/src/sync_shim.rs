//! The atomics and the futex of [`crate::Notify`] and of `linux::suspension`, or their `loom`
//! models under `--cfg loom`.
//!
//! `loom` explores every interleaving of the *real* protocol code over these types; only the
//! futex itself is a model: a mutex makes "compare, then sleep" one step, as the kernel does.

#[cfg(all(not(loom), target_os = "linux", not(nuttx_host)))]
pub(crate) use core::sync::atomic::{AtomicBool, AtomicU32, AtomicU64};
#[cfg(loom)]
pub(crate) use loom::sync::atomic::{AtomicBool, AtomicU32, AtomicU64};
#[cfg(loom)]
pub(crate) use modelled::FutexWord;
#[cfg(not(loom))]
pub(crate) use real::FutexWord;

/// `SeqCst` operations before this and after it have one order for all threads: in the model, which
/// takes `SeqCst` for acquire and release, it needs a fence.
#[cfg(all(target_os = "linux", not(nuttx_host)))]
#[inline]
pub(crate) fn one_order() {
    #[cfg(loom)]
    loom::sync::atomic::fence(core::sync::atomic::Ordering::SeqCst);
}

/// Reason why a futex wait returned.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Woken {
    /// Woken, interrupted, or the word had changed already: look at the word again.
    Look,
    /// The deadline has passed.
    TimedOut,
}

#[cfg(not(loom))]
mod real {
    //! One word of memory the kernel can wait on.

    use super::Woken;
    use crate::Nanos;
    use crate::backend::futex;
    use core::sync::atomic::AtomicU32;

    #[derive(Debug)]
    pub(crate) struct FutexWord(pub(crate) AtomicU32);

    impl FutexWord {
        pub(crate) const fn new(value: u32) -> Self {
            Self(AtomicU32::new(value))
        }

        /// Sleeps while the word has the value `expected`, at most until `deadline`.
        pub(crate) fn wait(&self, expected: u32, deadline: Option<Nanos>) -> Woken {
            if futex::wait(&self.0, expected, deadline) {
                Woken::TimedOut
            } else {
                Woken::Look
            }
        }

        pub(crate) fn wake_one(&self) {
            futex::wake_one(&self.0);
        }
    }
}

#[cfg(loom)]
mod modelled {
    //! The same word as a `loom` model.

    use super::Woken;
    use crate::Nanos;
    use loom::sync::atomic::{AtomicU32, Ordering};
    use loom::sync::{Condvar, Mutex, MutexGuard};

    #[derive(Debug)]
    pub(crate) struct FutexWord(pub(crate) AtomicU32, Mutex<()>, Condvar);

    impl FutexWord {
        pub(crate) fn new(value: u32) -> Self {
            Self(AtomicU32::new(value), Mutex::new(()), Condvar::new())
        }

        /// A wait with a deadline is modelled as one that expires as soon as others have had a
        /// chance to run: what remains to be explored is every race with the expiry.
        pub(crate) fn wait(&self, expected: u32, deadline: Option<Nanos>) -> Woken {
            let guard = self.lock();
            if self.0.load(Ordering::SeqCst) != expected {
                return Woken::Look;
            }
            if deadline.is_some() {
                drop(guard);
                loom::thread::yield_now();
                return Woken::TimedOut;
            }
            drop(self.2.wait(guard));
            Woken::Look
        }

        pub(crate) fn wake_one(&self) {
            let _guard = self.lock();
            self.2.notify_one();
        }

        fn lock(&self) -> MutexGuard<'_, ()> {
            self.1
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner)
        }
    }
}
