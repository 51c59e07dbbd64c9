//! The headers of messages and submessages.

use super::{ClientKey, SessionId, StreamId, WireError};
use crate::SeqNum;

/// The common part of all message headers of a stream.
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
    #[cfg_attr(not(feature = "std"), inline(never))]
    pub(crate) fn put(&self, seq: SeqNum, buf: &mut [u8]) -> Option<usize> {
        let [low, high] = seq.0.to_le_bytes();
        let (head, rest) = buf.split_first_chunk_mut()?;
        *head = [self.session.0, self.stream.0, low, high];
        if self.session.has_key() {
            *rest.first_chunk_mut()? = self.key.0;
        }
        Some(self.session.header_len())
    }
}

/// Flag bit 0 of a submessage: its body is little endian.
pub const FLAG_LITTLE_ENDIAN: u8 = 0x01;

pub(super) const SUBHEADER: usize = 4;

/// The numbers of the submessages (DDS-XRCE 1.0, 8.3.5).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(
    missing_docs,
    reason = "each is documented at the body of the same name"
)]
pub enum SubmessageId {
    CreateClient = 0,
    Create = 1,
    GetInfo = 2,
    Delete = 3,
    StatusAgent = 4,
    Status = 5,
    Info = 6,
    WriteData = 7,
    ReadData = 8,
    Data = 9,
    AckNack = 10,
    Heartbeat = 11,
    Reset = 12,
    Fragment = 13,
    Timestamp = 14,
    TimestampReply = 15,
}

impl SubmessageId {
    /// Whether it carries a sample, which may be longer than its 16 bits of length can say.
    pub(crate) const fn is_sample(self) -> bool {
        matches!(self, Self::WriteData | Self::Data)
    }

    /// The submessage with this number.
    ///
    /// # Errors
    /// [`WireError::UnknownSubmessage`] above 15.
    pub const fn from_number(number: u8) -> Result<Self, WireError> {
        Ok(match number {
            0 => SubmessageId::CreateClient,
            1 => SubmessageId::Create,
            2 => SubmessageId::GetInfo,
            3 => SubmessageId::Delete,
            4 => SubmessageId::StatusAgent,
            5 => SubmessageId::Status,
            6 => SubmessageId::Info,
            7 => SubmessageId::WriteData,
            8 => SubmessageId::ReadData,
            9 => SubmessageId::Data,
            10 => SubmessageId::AckNack,
            11 => SubmessageId::Heartbeat,
            12 => SubmessageId::Reset,
            13 => SubmessageId::Fragment,
            14 => SubmessageId::Timestamp,
            15 => SubmessageId::TimestampReply,
            _ => return Err(WireError::UnknownSubmessage(number)),
        })
    }
}

/// A message header: 4 bytes, or 8 with the client key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// The session.
    pub session: SessionId,
    /// The stream, or [`StreamId::NONE`].
    pub stream: StreamId,
    /// The message's number in its stream; 0 without a stream.
    pub seq: SeqNum,
    /// The client's key, present iff `session.has_key()`.
    pub key: Option<ClientKey>,
}

impl Header {
    /// A header; `key` is kept only if the session id asks for it.
    #[must_use]
    pub fn new(session: SessionId, stream: StreamId, seq: SeqNum, key: ClientKey) -> Self {
        Header {
            session,
            stream,
            seq,
            key: session.has_key().then_some(key),
        }
    }

    /// Writes it to the front of `buf`; gives its length.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn encode(&self, buf: &mut [u8]) -> Result<usize, WireError> {
        let (needed, left) = (self.session.header_len(), buf.len());
        let header = StreamHeader {
            session: self.session,
            stream: self.stream,
            key: self.key.unwrap_or(ClientKey([0; 4])),
        };
        let written = header.put(self.seq, buf);
        written.ok_or(WireError::NoRoom { needed, left })
    }

    /// Splits a message into its header and the rest.
    #[inline]
    pub(super) fn split(bytes: &[u8]) -> Result<(Self, &[u8]), WireError> {
        let short = |needed| WireError::Truncated {
            needed,
            left: bytes.len(),
        };
        let (&[session, stream, low, high], rest) =
            bytes.split_first_chunk().ok_or_else(|| short(4))?;
        let session = SessionId(session);
        let mut header = Header {
            session,
            stream: StreamId(stream),
            seq: SeqNum(u16::from_le_bytes([low, high])),
            key: None,
        };
        if !session.has_key() {
            return Ok((header, rest));
        }
        let (key, rest) = rest.split_first_chunk().ok_or_else(|| short(8))?;
        header.key = Some(ClientKey(*key));
        Ok((header, rest))
    }
}
