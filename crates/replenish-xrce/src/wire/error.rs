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
    /// A body longer than the 16-bit submessage length can say.
    TooLong {
        /// The body's length in bytes.
        len: usize,
    },
    /// The message starts without the four bytes `XRCE` where they must be.
    BadCookie,
    /// A string that is not UTF-8 or has a NUL inside.
    BadString,
    /// A submessage id that DDS-XRCE 1.0 does not define.
    UnknownSubmessage(u8),
    /// An object kind that cannot be created or described here.
    UnknownKind(u8),
    /// A representation format other than reference, XML or binary.
    UnknownRepresentation(u8),
    /// A data format other than plain data (`FORMAT_DATA`).
    UnknownDataFormat(u8),
}

impl fmt::Display for WireError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            WireError::Truncated { needed, left } => {
                write!(
                    f,
                    "truncated: the next field needs {needed} bytes, {left} are left"
                )
            }
            WireError::NoRoom { needed, left } => {
                write!(
                    f,
                    "no room: the next field needs {needed} bytes, {left} are left"
                )
            }
            WireError::TooLong { len } => {
                write!(
                    f,
                    "a body of {len} bytes is longer than a submessage can be (65535)"
                )
            }
            WireError::BadCookie => f.write_str("the cookie is not \"XRCE\""),
            WireError::BadString => f.write_str("a string is not UTF-8 or has a NUL inside"),
            WireError::UnknownSubmessage(id) => write!(f, "unknown submessage id {id:#04x}"),
            WireError::UnknownKind(kind) => write!(f, "unsupported object kind {kind:#03x}"),
            WireError::UnknownRepresentation(x) => write!(f, "unknown representation {x:#04x}"),
            WireError::UnknownDataFormat(x) => write!(f, "unsupported data format {x:#04x}"),
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
