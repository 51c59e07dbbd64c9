//! Data shared by tasks and interrupts: reached with interrupts masked, for a few instructions.
//!
//! ```text
//!   CriticalSection::enter() ─► section ─ token() ─► CsToken: its holder need not mask again
//!                               drop ─► the mask is as before
//! ```
#![expect(
    unsafe_code,
    reason = "lends out the content of an UnsafeCell under the mask"
)]

use super::cs_token::CsToken;
use crate::backend::port;
use core::cell::UnsafeCell;

/// A stretch with the kernel's interrupts masked, and with them its task switches.
///
/// Dropping it restores the mask of before, so sections nest.
pub(crate) struct CriticalSection(u32);

impl CriticalSection {
    #[cfg_attr(feature = "outlined", inline(never))]
    pub(crate) fn enter() -> Self {
        Self(port::mask())
    }

    /// A token for functions that must be called masked.
    #[expect(clippy::unused_self, reason = "its life is the proof")]
    pub(crate) const fn token(&self) -> CsToken<'_> {
        // SAFETY: masked for as long as `self` lives, which the token's lifetime ends before.
        unsafe { CsToken::assume() }
    }
}

impl Drop for CriticalSection {
    fn drop(&mut self) {
        port::unmask(self.0);
    }
}

/// A value that is only touched inside critical sections.
pub(crate) struct Guarded<T>(UnsafeCell<T>);

// SAFETY: one core; every access masks the interrupts and switches that could see the value.
unsafe impl<T: Send> Sync for Guarded<T> {}

impl<T> Guarded<T> {
    pub(crate) const fn new(value: T) -> Self {
        Self(UnsafeCell::new(value))
    }

    /// Runs `f` on the value. `f` is short, does not wait and does not touch this value again.
    pub(crate) fn with<R>(&self, f: impl FnOnce(&mut T) -> R) -> R {
        let section = CriticalSection::enter();
        self.within(section.token(), f)
    }

    /// As [`with`](Self::with), in a section of the caller's.
    pub(crate) fn within<R>(&self, _: CsToken<'_>, f: impl FnOnce(&mut T) -> R) -> R {
        // SAFETY: masked, one core, no re-entry: this is the only reference.
        f(unsafe { &mut *self.0.get() })
    }
}

impl<T> core::fmt::Debug for Guarded<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Guarded")
    }
}
