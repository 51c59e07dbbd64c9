//! Data shared by tasks and interrupts: reached with interrupts masked, for a few instructions.
#![expect(
    unsafe_code,
    reason = "lends out the content of an UnsafeCell under the mask"
)]

use super::ffi;
use core::cell::UnsafeCell;

/// A value that is only touched with the kernel's interrupts masked.
pub(crate) struct Masked<T>(UnsafeCell<T>);

// SAFETY: one core, and `with` masks every interrupt and switch that could see the value.
unsafe impl<T: Send> Sync for Masked<T> {}

impl<T> Masked<T> {
    pub(crate) const fn new(value: T) -> Self {
        Self(UnsafeCell::new(value))
    }

    /// Runs `f` on the value. `f` is short, does not wait and does not touch this value again.
    pub(crate) fn with<R>(&self, f: impl FnOnce(&mut T) -> R) -> R {
        let before = ffi::mask();
        // SAFETY: masked, one core, no re-entry: this is the only reference.
        let result = f(unsafe { &mut *self.0.get() });
        ffi::unmask(before);
        result
    }
}

impl<T> core::fmt::Debug for Masked<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Masked")
    }
}
