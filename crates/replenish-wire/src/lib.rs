//! A bounds-checked cursor over received CDR, for the decoders of RTPS and of DDS-XRCE.
//!
//! Each protocol has an error of its own, which says the two things that a reader can find:
//! [`ReadError`]. No bytes make this crate panic.
//!
//! Long samples are [copied](copy()) by a function that all crates on their way share.
//!
//! Messages of ROS 2 are read by `replenish-msg`, which decodes in place and names the place of an
//! error.
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

mod copy;
mod reader;

pub use copy::{copy, piece};
pub use reader::{ReadError, Reader};

/// Bytes from `pos` to the next multiple of `to` (a power of two).
#[must_use]
pub const fn padding(pos: usize, to: usize) -> usize {
    pos.wrapping_neg() & to.wrapping_sub(1)
}
