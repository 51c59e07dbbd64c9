//! Errors of an encoded message.

use core::fmt;

/// Reason why bytes could not be encoded or decoded. Offsets and lengths are in bytes from the
/// start of the payload unless said otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum CdrError {
    /// The buffer ends inside an item.
    EndOfBuffer {
        /// Position of the item, or of its padding.
        at: usize,
        /// Bytes the item takes, with its padding.
        needed: usize,
        /// Bytes that are left.
        available: usize,
    },
    /// The contents of a string are not UTF-8.
    NotUtf8 {
        /// Position of the first bad byte.
        at: usize,
    },
    /// The last byte that a string's length counts is not NUL.
    NotTerminated {
        /// Position at which the NUL should be.
        at: usize,
    },
    /// A `bool` that is neither 0 nor 1.
    NotBool {
        /// Position of the byte.
        at: usize,
        /// Its value.
        value: u8,
    },
    /// The contents of a `wstring` are not UTF-16.
    NotUtf16 {
        /// Position of the string's contents.
        at: usize,
    },
    /// An encapsulation header that announces something else than XCDR1.
    Encapsulation {
        /// The representation identifier: 0 and 1 are XCDR1, big- and little-endian.
        id: u16,
    },
    /// A string (in bytes, without NUL) or sequence (in elements) is longer than its field holds.
    TooLong {
        /// The length found.
        len: usize,
        /// The capacity of the field.
        limit: usize,
    },
}

impl fmt::Display for CdrError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::EndOfBuffer {
                at,
                needed,
                available,
            } => write!(
                f,
                "buffer ends at offset {at}: {needed} bytes needed, {available} available"
            ),
            Self::NotUtf8 { at } => write!(f, "string is not UTF-8 at offset {at}"),
            Self::NotUtf16 { at } => write!(f, "wstring at offset {at} is not UTF-16"),
            Self::Encapsulation { id } => write!(
                f,
                "encapsulation {id:#06x} is neither 0x0000 nor 0x0001 (XCDR1, big and little endian)"
            ),
            Self::NotTerminated { at } => {
                write!(f, "string is not NUL-terminated at offset {at}")
            }
            Self::NotBool { at, value } => {
                write!(f, "bool at offset {at} is {value}, neither 0 nor 1")
            }
            Self::TooLong { len, limit } => {
                write!(f, "length {len} is above the field's capacity of {limit}")
            }
        }
    }
}

impl core::error::Error for CdrError {}
