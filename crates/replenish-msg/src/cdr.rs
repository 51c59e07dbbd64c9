//! XCDR version 1 (OMG DDS-XTypes 1.3, clause 7.4.1): the encoding of every ROS 2 message.
//!
//! The rules that matter here:
//! - a primitive of size n is aligned to n (at most 8) *relative to the start of the payload*;
//! - a string is a `u32` length that counts the terminating NUL, the bytes, the NUL;
//! - an unbounded or bounded sequence is a `u32` number of elements, then the elements;
//! - a fixed-size array is its elements alone.
//!
//! Writing is little endian; reading takes either order, because the sender chooses.

mod error;
mod reader;
mod writer;

pub use error::CdrError;
pub use reader::{CdrReader, Endianness};
pub use writer::CdrWriter;

/// Padding bytes before an item of `align` bytes (a power of two, at most 8) at `pos`.
const fn padding(pos: usize, align: usize) -> usize {
    pos.wrapping_neg() & (align - 1)
}

/// Bytes a string of `capacity` bytes can take from an offset that is a multiple of 4:
/// length, contents, NUL.
///
/// For the arithmetic of [`Message::MAX_SIZE`](crate::Message::MAX_SIZE).
pub const fn max_string_size(capacity: usize) -> usize {
    4 + capacity + 1
}

/// `size` rounded up to the next multiple of `align` (a power of two, at most 8).
///
/// For the arithmetic of [`Message::MAX_SIZE`](crate::Message::MAX_SIZE).
pub const fn aligned(size: usize, align: usize) -> usize {
    size + padding(size, align)
}
