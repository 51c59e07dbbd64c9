//! Numbers of 64 bits that tasks share, on a processor of 32: reached with interrupts masked. A
//! lock that spins, as libraries bring it, would hang where a higher task waits for a lower one.

use super::critical_section::Guarded;
use core::sync::atomic::Ordering;

/// As `core::sync::atomic::AtomicU64`, where the processor has none.
///
/// Each access is sequentially consistent, in any requested order: there is one core, and the
/// mask keeps the compiler from moving accesses.
#[derive(Debug)]
pub struct AtomicU64(Guarded<u64>);

impl AtomicU64 {
    /// A number.
    #[must_use]
    pub const fn new(value: u64) -> Self {
        Self(Guarded::new(value))
    }

    /// Its value.
    pub fn load(&self, _: Ordering) -> u64 {
        self.0.with(|v| *v)
    }

    /// Sets it.
    pub fn store(&self, value: u64, _: Ordering) {
        self.0.with(|v| *v = value);
    }

    /// Sets it; the value before.
    pub fn swap(&self, value: u64, _: Ordering) -> u64 {
        self.0.with(|v| core::mem::replace(v, value))
    }

    /// Adds, wrapping around; the value before.
    #[inline(never)]
    pub fn fetch_add(&self, value: u64, _: Ordering) -> u64 {
        self.0.with(|v| {
            let sum = v.wrapping_add(value);
            core::mem::replace(v, sum)
        })
    }

    /// Adds, wrapping around; in place, for what each message comes by.
    #[inline(always)]
    pub fn count(&self, value: u64) {
        self.0.with(|v| *v = v.wrapping_add(value));
    }

    /// Sets the bits that are set in `value`; the value before.
    pub fn fetch_or(&self, value: u64, _: Ordering) -> u64 {
        self.0.with(|v| {
            let bits = *v | value;
            core::mem::replace(v, bits)
        })
    }

    /// Clears the bits that are clear in `value`; the value before.
    pub fn fetch_and(&self, value: u64, _: Ordering) -> u64 {
        self.0.with(|v| {
            let bits = *v & value;
            core::mem::replace(v, bits)
        })
    }

    /// Raises it to `value` if it is lower; the value before.
    pub fn fetch_max(&self, value: u64, _: Ordering) -> u64 {
        self.0.with(|v| {
            let max = value.max(*v);
            core::mem::replace(v, max)
        })
    }

    /// Sets it to `new` if it is `current`; the value before.
    ///
    /// # Errors
    /// The value, if it is another.
    pub fn compare_exchange(
        &self,
        current: u64,
        new: u64,
        _: Ordering,
        _: Ordering,
    ) -> Result<u64, u64> {
        self.0.with(|v| {
            if *v == current {
                *v = new;
                Ok(current)
            } else {
                Err(*v)
            }
        })
    }
}

impl Default for AtomicU64 {
    fn default() -> Self {
        Self::new(0)
    }
}
