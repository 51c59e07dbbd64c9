//! What the standard library gives where there is one, and what stands in for it where not.

#[cfg(not(feature = "std"))]
mod bare;
#[cfg(not(feature = "std"))]
pub mod io;
#[cfg(feature = "std")]
mod std;

#[cfg(not(feature = "std"))]
pub(crate) use bare::*;
#[cfg(feature = "std")]
pub(crate) use std::*;

/// A buffer of `len` bytes. (One body for all of them.)
#[inline(never)]
pub(crate) fn zeroed(len: usize) -> alloc::boxed::Box<[u8]> {
    alloc::vec![0; len].into_boxed_slice()
}

/// A value that is dropped in its time where things are given back, which is on targets without an
/// operating system with feature `full` only; else it stays as long as the image.
#[cfg(any(not(target_os = "none"), feature = "full"))]
pub(crate) type Kept<T> = T;
#[cfg(not(any(not(target_os = "none"), feature = "full")))]
pub(crate) type Kept<T> = core::mem::ManuallyDrop<T>;

/// Keeps `value`.
#[cfg(any(not(target_os = "none"), feature = "full"))]
pub(crate) const fn kept<T>(value: T) -> Kept<T> {
    value
}

#[cfg(not(any(not(target_os = "none"), feature = "full")))]
pub(crate) const fn kept<T>(value: T) -> Kept<T> {
    core::mem::ManuallyDrop::new(value)
}
