//! Data shared by tasks and interrupts: reached with interrupts masked, for a few instructions.
//!
//! ```text
//!   Mask::set() ─► mask ── mask.quiet() ─► Quiet: whoever has one may look, without masking again
//!                  drop ─► as before
//! ```
#![expect(
    unsafe_code,
    reason = "lends out the content of an UnsafeCell under the mask"
)]

use super::ffi;
use core::cell::UnsafeCell;
use core::marker::PhantomData;

/// The interrupts that may call the kernel are masked until this is dropped, and with them its
/// switches. Masks nest.
pub(crate) struct Mask(u32);

impl Mask {
    pub(crate) fn set() -> Self {
        Self(ffi::mask())
    }

    /// For what has to be called masked.
    #[expect(clippy::unused_self, reason = "its life is the proof")]
    pub(crate) const fn quiet(&self) -> Quiet<'_> {
        Quiet(PhantomData)
    }
}

impl Drop for Mask {
    fn drop(&mut self) {
        ffi::unmask(self.0);
    }
}

/// Proof that interrupts are masked for as long as this lives. It takes no room.
#[derive(Clone, Copy)]
pub(crate) struct Quiet<'a>(PhantomData<&'a Mask>);

impl Quiet<'_> {
    /// For who is called masked from outside.
    ///
    /// # Safety
    /// The kernel's interrupts are masked now, and until the caller has returned.
    #[cfg(target_os = "none")]
    pub(crate) const unsafe fn by_caller() -> Self {
        Self(PhantomData)
    }
}

/// A value that is only touched with the kernel's interrupts masked.
pub(crate) struct Masked<T>(UnsafeCell<T>);

// SAFETY: one core, and every access is masked against interrupts and switches that could see the value.
unsafe impl<T: Send> Sync for Masked<T> {}

impl<T> Masked<T> {
    pub(crate) const fn new(value: T) -> Self {
        Self(UnsafeCell::new(value))
    }

    /// Runs `f` on the value. `f` is short, does not wait and does not touch this value again.
    pub(crate) fn with<R>(&self, f: impl FnOnce(&mut T) -> R) -> R {
        let mask = Mask::set();
        self.within(mask.quiet(), f)
    }

    /// The same for who is masked already.
    pub(crate) fn within<R>(&self, _: Quiet<'_>, f: impl FnOnce(&mut T) -> R) -> R {
        // SAFETY: masked, one core, no re-entry: this is the only reference.
        f(unsafe { &mut *self.0.get() })
    }
}

impl<T> core::fmt::Debug for Masked<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Masked")
    }
}
