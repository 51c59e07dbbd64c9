//! Streams: sequences of messages in one direction, best effort or reliable.
//!
//! ```text
//!             push(body)                                 deliver(submessage)
//!   writer ──► OutputBestEffort ── datagram ──► InputBestEffort ──► reader     order kept, losses not repaired
//!   writer ──► OutputReliable   ── datagram ──► InputReliable   ──► reader     exactly once, in order
//!                    ▲   └─────── HEARTBEAT ───────►  │
//!                    └─────────── ACKNACK ────────────┘
//! ```
//!
//! Client and agent use the same four machines. Their storage is any `AsRef<[u8]> + AsMut<[u8]>`
//! (an array, a slice, a box) given once; nothing is allocated. Consecutive submessages are packed
//! into one message until it is taken for sending.

mod carry;
mod input_best_effort;
mod input_reliable;
mod output_best_effort;
mod output_reliable;
mod reassembly;
mod ring;
#[cfg_attr(not(feature = "rtt"), path = "rtt_none.rs")]
mod rtt;
mod spill;

pub use carry::Carried;
pub use input_best_effort::{BestEffortStats, InputBestEffort};
pub use input_reliable::{AckPolicy, InputReliable, InputStats};
pub use output_best_effort::OutputBestEffort;
pub use output_reliable::{OutputReliable, OutputStats, Reliability};

use core::fmt;

use crate::SeqNum;
use crate::wire::{ClientKey, Encode, Header, SessionId, StreamId, WireError, submessage_len};

/// What all message headers of a stream have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamHeader {
    /// The session.
    pub session: SessionId,
    /// The stream.
    pub stream: StreamId,
    /// The client's key; sent iff the session id asks for it.
    pub key: ClientKey,
}

impl StreamHeader {
    /// The header of message `seq`.
    #[must_use]
    pub fn at(&self, seq: SeqNum) -> Header {
        Header::new(self.session, self.stream, seq, self.key)
    }

    /// Writes the header of message `seq` to the front of `buf`; its length, if there is room.
    pub(crate) fn put(&self, seq: SeqNum, buf: &mut [u8]) -> Option<usize> {
        let [low, high] = seq.0.to_le_bytes();
        let (head, rest) = buf.split_first_chunk_mut()?;
        *head = [self.session.0, self.stream.0, low, high];
        if self.session.has_key() {
            *rest.first_chunk_mut()? = self.key.0;
        }
        Some(self.len())
    }

    /// Bytes of a header: 4 or 8.
    #[must_use]
    pub const fn len(&self) -> usize {
        if self.session.has_key() { 8 } else { 4 }
    }

    /// Never: a header takes at least 4 bytes.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        false
    }
}

/// Whether the last submessage of a message is padded to a multiple of four bytes. Both forms are
/// understood everywhere; each side does what eProsima's implementation of that side does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tail {
    /// Padded: clients.
    Padded,
    /// Not padded: agents.
    Exact,
}

impl Tail {
    const fn is_padded(self) -> bool {
        matches!(self, Tail::Padded)
    }
}

/// Why a submessage was not taken by an output stream. Nothing of it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PushError {
    /// There is no room now; there will be after messages are taken for sending or, on a reliable
    /// stream, acknowledged.
    WouldBlock,
    /// It can never be sent on this stream.
    TooLarge {
        /// Bytes of the submessage with its header.
        size: usize,
        /// The most this stream takes.
        limit: usize,
    },
    /// It cannot be encoded at all.
    Wire(WireError),
}

/// What a submessage takes with its header and padding, if that is within `limit`.
fn size_within<B: Encode + ?Sized>(limit: usize, body: &B) -> Result<usize, PushError> {
    let size = submessage_len(body).map_err(PushError::Wire)?;
    match size > limit {
        true => Err(PushError::TooLarge { size, limit }),
        false => Ok(size),
    }
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
