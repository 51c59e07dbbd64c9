//! The atomic words below a ring: the processor's, or those of a model.

use core::sync::atomic::Ordering;
#[cfg(target_has_atomic = "64")]
use core::sync::atomic::{AtomicU64, fence};

/// A word that the program writes and others read.
pub trait Word {
    /// Its value.
    fn load(&self, order: Ordering) -> u64;
    /// Gives it a value.
    fn store(&self, value: u64, order: Ordering);
    /// Adds to its value, where several threads write.
    fn add(&self, n: u64);
    /// A fence for accesses to all words of this type.
    fn fence(order: Ordering);
}

/// Little-endian in memory, as the file has it.
#[cfg(target_has_atomic = "64")]
impl Word for AtomicU64 {
    #[inline]
    fn load(&self, order: Ordering) -> u64 {
        u64::from_le(Self::load(self, order))
    }

    #[inline]
    fn store(&self, value: u64, order: Ordering) {
        Self::store(self, value.to_le(), order);
    }

    #[inline]
    fn add(&self, n: u64) {
        if cfg!(target_endian = "little") {
            self.fetch_add(n, Ordering::Relaxed);
        } else {
            let sum = |word: u64| Some(u64::from_le(word).wrapping_add(n).to_le());
            self.fetch_update(Ordering::Relaxed, Ordering::Relaxed, sum)
                .ok(); // it never refuses
        }
    }

    #[inline]
    fn fence(order: Ordering) {
        fence(order);
    }
}

#[cfg(loom)]
impl Word for loom::sync::atomic::AtomicU64 {
    fn load(&self, order: Ordering) -> u64 {
        Self::load(self, order)
    }

    fn store(&self, value: u64, order: Ordering) {
        Self::store(self, value, order);
    }

    fn add(&self, n: u64) {
        self.fetch_add(n, Ordering::Relaxed);
    }

    fn fence(order: Ordering) {
        loom::sync::atomic::fence(order);
    }
}
