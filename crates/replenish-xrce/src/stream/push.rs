//! The errors and form of submessages that are pushed to output streams.

use crate::wire::{Encode, WireError, submessage_len};
use core::fmt;

/// Whether the last submessage of a message is padded to a multiple of four bytes. Both forms are
/// understood everywhere; each side does what eProsima's implementation of that side does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tail {
    /// Padded: clients.
    Padded,
    /// Submessages are not padded: agents.
    Exact,
}

impl Tail {
    pub(super) const fn is_padded(self) -> bool {
        matches!(self, Tail::Padded)
    }
}

/// Reason why a submessage was not taken by an output stream. Nothing of it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PushError {
    /// There is no room now; there will be after messages are taken for sending or, on a reliable
    /// stream, acknowledged.
    WouldBlock,
    /// The submessage can never be sent on this stream.
    TooLarge {
        /// Bytes of the submessage with its header.
        size: usize,
        /// The most this stream takes.
        limit: usize,
    },
    /// The submessage cannot be encoded at all.
    Wire(WireError),
}

/// The size of a submessage with header and padding, if it is within `limit`.
pub(super) fn size_within<B: Encode + ?Sized>(limit: usize, body: &B) -> Result<usize, PushError> {
    let size = submessage_len(body).map_err(PushError::Wire)?;
    if size > limit {
        return Err(PushError::TooLarge { size, limit });
    }
    Ok(size)
}

impl fmt::Display for PushError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PushError::WouldBlock => f.write_str("the stream is full"),
            PushError::TooLarge { size, limit } => {
                write!(
                    f,
                    "a submessage of {size} bytes; the stream's limit is {limit}"
                )
            }
            PushError::Wire(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for PushError {}
