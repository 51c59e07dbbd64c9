//! Messages: the header, and walking the submessages of a received message.

use super::{Body, ClientKey, Data, SessionId, StreamId, WireError, padding};
use crate::SeqNum;
use crate::stream::StreamHeader;

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

    /// Bytes it takes on the wire: 4 or 8.
    #[must_use]
    pub const fn len(&self) -> usize {
        if self.session.has_key() { 8 } else { 4 }
    }

    /// Never: it takes at least 4 bytes.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        false
    }

    /// Writes it to the front of `buf`; gives its length.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn encode(&self, buf: &mut [u8]) -> Result<usize, WireError> {
        let (needed, left) = (self.len(), buf.len());
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
    fn split(bytes: &[u8]) -> Result<(Self, &[u8]), WireError> {
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

/// A received message: its header and the bytes of its submessages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message<'a> {
    /// The header.
    pub header: Header,
    /// Everything after the header.
    pub body: &'a [u8],
}

impl<'a> Message<'a> {
    /// Splits a datagram (or frame) into header and body.
    ///
    /// # Errors
    /// [`WireError::Truncated`].
    #[inline]
    pub fn parse(datagram: &'a [u8]) -> Result<Self, WireError> {
        let (header, body) = Header::split(datagram)?;
        Ok(Message { header, body })
    }

    /// The submessages in order.
    #[must_use]
    pub const fn submessages(&self) -> Submessages<'a> {
        Submessages::new(self.body)
    }
}

/// A submessage as it stands in a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Submessage<'a> {
    /// What it is.
    pub id: SubmessageId,
    /// Its flag byte.
    pub flags: u8,
    /// Its body, not yet decoded.
    pub payload: &'a [u8],
}

impl<'a> Submessage<'a> {
    /// Decodes the body.
    ///
    /// # Errors
    /// Every [`WireError`] but `NoRoom` and `TooLong`.
    pub fn body(&self) -> Result<Body<'a>, WireError> {
        Body::decode(self.id, self.flags, self.payload)
    }

    /// The byte order of its body.
    pub(crate) const fn little_endian(&self) -> bool {
        self.flags & FLAG_LITTLE_ENDIAN != 0
    }

    /// Decodes the body of a sample, which most are.
    #[inline]
    pub(crate) fn data(&self) -> Option<Data<'a>> {
        if self.id != SubmessageId::Data {
            return None;
        }
        Data::split(self.payload, self.flags)
    }
}

/// Walks submessages; ends after the first one that is malformed.
#[derive(Clone, Debug)]
pub struct Submessages<'a> {
    bytes: &'a [u8],
    pos: usize,
}

impl<'a> Submessages<'a> {
    /// Walks `bytes`, which start at a submessage header.
    #[must_use]
    pub const fn new(bytes: &'a [u8]) -> Self {
        Submessages { bytes, pos: 0 }
    }

    /// What the next submessage is, and its flags, even if it is too short for what it says.
    pub(crate) fn peek(&self) -> Option<(SubmessageId, u8)> {
        let [id, flags] = *self.bytes.get(self.pos..)?.first_chunk()?;
        Some((SubmessageId::from_number(id).ok()?, flags))
    }

    /// The next submessage; `None` at the end, and if it is malformed.
    #[inline]
    pub(crate) fn whole(&mut self) -> Option<Submessage<'a>> {
        let rest = self.bytes.get(self.pos..)?;
        let (&[id, flags, low, high], rest) = rest.split_first_chunk()?;
        let len = usize::from(u16::from_le_bytes([low, high]));
        let id = SubmessageId::from_number(id).ok()?;
        let payload = rest.get(..len)?;
        let end = self.pos.wrapping_add(SUBHEADER).wrapping_add(len);
        self.pos = end.wrapping_add(padding(end, 4));
        Some(Submessage { id, flags, payload })
    }

    /// Whether nothing is left: else the next submessage is malformed, if it is not whole.
    pub(crate) const fn is_done(&self) -> bool {
        self.pos >= self.bytes.len()
    }

    /// What is wrong with the next submessage.
    fn error(&self) -> WireError {
        let rest = self.bytes.get(self.pos..).unwrap_or(&[]);
        let short = |needed, left| WireError::Truncated { needed, left };
        let Some((&[id, _, low, high], rest)) = rest.split_first_chunk() else {
            return short(SUBHEADER, rest.len());
        };
        let len = usize::from(u16::from_le_bytes([low, high]));
        match SubmessageId::from_number(id) {
            Ok(_) => short(len, rest.len()),
            Err(error) => error,
        }
    }
}

impl<'a> Iterator for Submessages<'a> {
    type Item = Result<Submessage<'a>, WireError>;

    #[inline]
    fn next(&mut self) -> Option<Self::Item> {
        if self.is_done() {
            return None;
        }
        if let Some(submessage) = self.whole() {
            return Some(Ok(submessage));
        }
        let error = self.error();
        self.pos = self.bytes.len();
        Some(Err(error))
    }
}
