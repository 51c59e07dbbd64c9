//! The proof that the code runs inside a critical section.

use core::marker::PhantomData;

/// Proof that the kernel's interrupts are masked for `'a`. It takes no memory.
///
/// A [`CriticalSection`](super::critical_section::CriticalSection) lends it out.
#[derive(Clone, Copy)]
pub(crate) struct CsToken<'a>(PhantomData<&'a ()>);

impl CsToken<'_> {
    /// A token without a section of its own.
    ///
    /// # Safety
    /// The kernel's interrupts are masked now and for the token's whole lifetime.
    #[expect(unsafe_code, reason = "the caller vouches for the mask")]
    pub(crate) const unsafe fn assume() -> Self {
        Self(PhantomData)
    }
}
