//! Buffers of bytes.

use alloc::boxed::Box;

/// A buffer of `len` bytes. (One body for all callers.)
#[inline(never)]
pub(crate) fn zeroed(len: usize) -> Box<[u8]> {
    alloc::vec![0; len].into_boxed_slice()
}
