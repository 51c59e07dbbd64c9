//! Errors of bytes from the wire, and of buffers to write them to.

use core::fmt;
use replenish_wire::ReadError;

/// A bounds-checked cursor over received CDR.
pub type Reader<'a> = replenish_wire::Reader<'a, WireError>;

/// Reason why bytes could not be decoded, or a value not be encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum WireError {
    /// The bytes end before the value does.
    Truncated {
        /// Bytes the next field needs.
        needed: usize,
        /// Bytes that were left.
        left: usize,
    },
    /// The buffer to encode into is too small.
    NoRoom {
        /// Bytes the next field needs.
        needed: usize,
        /// Bytes that were left.
        left: usize,
    },
    /// A submessage or parameter longer than its 16-bit length can say.
    TooLong {
        /// Its length in bytes.
        len: usize,
    },
    /// The message starts without the four bytes `RTPS`.
    BadMagic,
    /// A protocol version other than 2.x; the major version that was read.
    BadVersion(u8),
    /// A string that is not UTF-8 or has a NUL inside.
    BadString,
    /// A field outside of its range; the field's name in the specification.
    OutOfRange(&'static str),
    /// A parameter that must be there is missing; its name in the specification.
    Missing(&'static str),
    /// A payload whose representation is not the expected one; the representation identifier.
    BadEncapsulation(u16),
}

impl fmt::Display for WireError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            WireError::Truncated { needed, left } => write!(
                f,
                "truncated: the next field needs {needed} bytes, {left} are left"
            ),
            WireError::NoRoom { needed, left } => write!(
                f,
                "no room: the next field needs {needed} bytes, {left} are left"
            ),
            WireError::TooLong { len } => write!(
                f,
                "{len} bytes are longer than a 16-bit length can say (65535)"
            ),
            WireError::BadMagic => f.write_str("the message does not start with \"RTPS\""),
            WireError::BadVersion(major) => {
                write!(f, "protocol version {major}.x; supported is 2.x")
            }
            WireError::BadString => f.write_str("a string is not UTF-8 or has a NUL inside"),
            WireError::OutOfRange(field) => write!(f, "{field} is outside of its range"),
            WireError::Missing(field) => write!(f, "the parameter {field} is missing"),
            WireError::BadEncapsulation(id) => {
                write!(f, "unexpected representation identifier {id:#06x}")
            }
        }
    }
}

impl core::error::Error for WireError {}

impl ReadError for WireError {
    fn truncated(needed: usize, left: usize) -> Self {
        Self::Truncated { needed, left }
    }
    fn bad_string() -> Self {
        Self::BadString
    }
}
