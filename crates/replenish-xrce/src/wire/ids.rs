//! Identifiers and small enumerations of the protocol (DDS-XRCE 1.0, clause 7.7 and annex A).

use core::fmt;

use super::{Reader, WireError, Writer};

/// Identifies a client to an agent, chosen by the client. All zeros is invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ClientKey(pub [u8; 4]);

impl fmt::Display for ClientKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:08x}", u32::from_be_bytes(self.0))
    }
}

/// Identifies a session of a client. Below 0x80 the client key follows in every message header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SessionId(pub u8);

impl SessionId {
    /// "No session yet", key in the header.
    pub const NONE_WITH_KEY: SessionId = SessionId(0x00);
    /// "No session yet", no key in the header.
    pub const NONE_WITHOUT_KEY: SessionId = SessionId(0x80);

    /// Whether the message header carries the client key.
    #[must_use]
    pub const fn has_key(self) -> bool {
        self.0 < 0x80
    }

    /// Bytes of a message header: 4, or 8 with the client key.
    #[must_use]
    pub const fn header_len(self) -> usize {
        if self.has_key() { 8 } else { 4 }
    }

    /// Whether no session is meant.
    #[must_use]
    pub const fn is_none(self) -> bool {
        self.0 & 0x7f == 0
    }

    /// The id to use before the session exists, with or without key like `self`.
    #[must_use]
    pub const fn before_login(self) -> SessionId {
        SessionId(self.0 & 0x80)
    }
}

/// Identifies a stream of a session. Each direction has its own streams.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct StreamId(pub u8);

impl StreamId {
    /// No stream: log-in, acknowledgements, heartbeats, time. The sequence number is 0.
    pub const NONE: StreamId = StreamId(0);
    /// The first best-effort stream, the one micro-ROS uses.
    pub const BEST_EFFORT: StreamId = StreamId(0x01);
    /// The first reliable stream, the one micro-ROS uses.
    pub const RELIABLE: StreamId = StreamId(0x80);

    /// Best-effort stream `index`, 0..=126: 0x01 and up.
    #[must_use]
    pub const fn best_effort(index: u8) -> StreamId {
        StreamId(if index < 0x7f {
            index.wrapping_add(1)
        } else {
            0x7f
        })
    }

    /// Reliable stream `index`, 0..=127: 0x80 and up.
    #[must_use]
    pub const fn reliable(index: u8) -> StreamId {
        StreamId(0x80 | index)
    }

    /// Number of the best-effort stream, from 0; `None` for another kind of stream.
    #[must_use]
    pub const fn best_effort_index(self) -> Option<usize> {
        if self.is_best_effort() {
            Some(self.0.wrapping_sub(1) as usize)
        } else {
            None
        }
    }

    /// Number of the reliable stream, from 0; `None` for another kind of stream.
    #[must_use]
    pub const fn reliable_index(self) -> Option<usize> {
        if self.is_reliable() {
            Some((self.0 & 0x7f) as usize)
        } else {
            None
        }
    }

    /// Ids from 0x80 on.
    #[must_use]
    pub const fn is_reliable(self) -> bool {
        self.0 >= 0x80
    }

    /// Ids from 1 to 0x7f.
    #[must_use]
    pub const fn is_best_effort(self) -> bool {
        self.0 >= 1 && self.0 < 0x80
    }
}

/// The kind of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the DDS entities of the same name")]
pub enum ObjectKind {
    Participant = 0x1,
    Topic = 0x2,
    Publisher = 0x3,
    Subscriber = 0x4,
    DataWriter = 0x5,
    DataReader = 0x6,
    Requester = 0x7,
    Replier = 0x8,
    Type = 0xa,
    QosProfile = 0xb,
    Application = 0xc,
    Agent = 0xd,
    Client = 0xe,
    Other = 0xf,
}

impl ObjectKind {
    /// The kind with this number.
    ///
    /// # Errors
    /// [`WireError::UnknownKind`] for 0, 9 and everything above 15.
    pub const fn from_number(number: u8) -> Result<Self, WireError> {
        Ok(match number {
            0x1 => ObjectKind::Participant,
            0x2 => ObjectKind::Topic,
            0x3 => ObjectKind::Publisher,
            0x4 => ObjectKind::Subscriber,
            0x5 => ObjectKind::DataWriter,
            0x6 => ObjectKind::DataReader,
            0x7 => ObjectKind::Requester,
            0x8 => ObjectKind::Replier,
            0xa => ObjectKind::Type,
            0xb => ObjectKind::QosProfile,
            0xc => ObjectKind::Application,
            0xd => ObjectKind::Agent,
            0xe => ObjectKind::Client,
            0xf => ObjectKind::Other,
            _ => return Err(WireError::UnknownKind(number)),
        })
    }

    /// The number on the wire.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }
}

/// Identifies an object of a client: 12 bits chosen by the client and the kind.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct ObjectId(u16);

impl ObjectId {
    /// The agent itself, in `GET_INFO`.
    pub const AGENT: ObjectId = ObjectId(0xfffd);
    /// The client itself: DELETE of it ends the session.
    pub const CLIENT: ObjectId = ObjectId(0xfffe);

    /// Object `id` (the low 12 bits count) of kind `kind`.
    #[must_use]
    pub const fn new(id: u16, kind: ObjectKind) -> Self {
        ObjectId((id << 4) | kind as u16)
    }

    /// Reads it from its two bytes on the wire; any value is allowed.
    #[must_use]
    pub const fn from_bytes(bytes: [u8; 2]) -> Self {
        ObjectId(u16::from_be_bytes(bytes))
    }

    /// Its two bytes on the wire.
    #[must_use]
    pub const fn to_bytes(self) -> [u8; 2] {
        self.0.to_be_bytes()
    }

    /// The client's number for it, 0..=4095.
    #[must_use]
    pub const fn number(self) -> u16 {
        self.0 >> 4
    }

    /// The kind in the low four bits.
    ///
    /// # Errors
    /// [`WireError::UnknownKind`] for kinds 0 and 9.
    pub const fn kind(self) -> Result<ObjectKind, WireError> {
        ObjectKind::from_number((self.0 & 0xf) as u8)
    }
}

impl fmt::Debug for ObjectId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.kind() {
            Ok(kind) => write!(f, "{kind:?}({:#05x})", self.number()),
            Err(_) => write!(f, "ObjectId({:#06x})", self.0),
        }
    }
}

/// The number of a client's request, which its reply repeats. Big endian on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RequestId(pub u16);

impl RequestId {
    /// No request.
    pub const NONE: RequestId = RequestId(0);
    /// Creation of the session.
    pub const LOGIN: RequestId = RequestId(1);
    /// Deletion of the session.
    pub const LOGOUT: RequestId = RequestId(2);
    /// The first number that is not reserved.
    pub const FIRST: RequestId = RequestId(10);

    /// The next number, skipping the reserved ones.
    #[must_use]
    pub const fn next(self) -> RequestId {
        match self.0.checked_add(1) {
            Some(next) if next > Self::FIRST.0 => RequestId(next),
            _ => Self::FIRST,
        }
    }
}

/// The first field of requests and replies: the request and its object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BaseRequest {
    /// The request.
    pub request: RequestId,
    /// The object it is about.
    pub object: ObjectId,
}

impl BaseRequest {
    /// Its four bytes on the wire.
    #[must_use]
    pub const fn to_bytes(self) -> [u8; 4] {
        let ([a, b], [c, d]) = (self.request.0.to_be_bytes(), self.object.to_bytes());
        [a, b, c, d]
    }

    /// Reads it from its four bytes on the wire; any value is allowed.
    #[must_use]
    pub const fn from_bytes([a, b, c, d]: [u8; 4]) -> Self {
        BaseRequest {
            request: RequestId(u16::from_be_bytes([a, b])),
            object: ObjectId::from_bytes([c, d]),
        }
    }

    /// Splits the payload at a requester into the answered request and the reply.
    #[must_use]
    pub fn split(payload: &[u8]) -> Option<(BaseRequest, &[u8])> {
        let (&bytes, rest) = payload.split_first_chunk()?;
        Some((BaseRequest::from_bytes(bytes), rest))
    }

    pub(super) fn write(self, w: &mut Writer<'_>) {
        w.put(&self.to_bytes());
    }

    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        r.array().map(Self::from_bytes)
    }
}

/// The outcome of a request.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Status(pub u8);

#[allow(missing_docs, reason = "the names say it; DDS-XRCE 1.0, 7.7.7")]
impl Status {
    pub const OK: Status = Status(0x00);
    pub const OK_MATCHED: Status = Status(0x01);
    pub const DDS_ERROR: Status = Status(0x80);
    pub const MISMATCH: Status = Status(0x81);
    pub const ALREADY_EXISTS: Status = Status(0x82);
    pub const DENIED: Status = Status(0x83);
    pub const UNKNOWN_REFERENCE: Status = Status(0x84);
    pub const INVALID_DATA: Status = Status(0x85);
    pub const INCOMPATIBLE: Status = Status(0x86);
    pub const RESOURCES: Status = Status(0x87);

    /// Whether the request was carried out.
    #[must_use]
    pub const fn is_ok(self) -> bool {
        self.0 < 0x80
    }

    const fn name(self) -> Option<&'static str> {
        Some(match self {
            Status::OK => "OK",
            Status::OK_MATCHED => "OK_MATCHED",
            Status::DDS_ERROR => "DDS_ERROR",
            Status::MISMATCH => "MISMATCH",
            Status::ALREADY_EXISTS => "ALREADY_EXISTS",
            Status::DENIED => "DENIED",
            Status::UNKNOWN_REFERENCE => "UNKNOWN_REFERENCE",
            Status::INVALID_DATA => "INVALID_DATA",
            Status::INCOMPATIBLE => "INCOMPATIBLE",
            Status::RESOURCES => "RESOURCES",
            _ => return None,
        })
    }
}

impl fmt::Debug for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name() {
            Some(name) => f.write_str(name),
            None => write!(f, "status {:#04x}", self.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn object_ids_are_twelve_bits_and_a_kind() {
        let id = ObjectId::new(0x001, ObjectKind::DataWriter);
        assert_eq!(id.to_bytes(), [0x00, 0x15]);
        assert_eq!((id.number(), id.kind()), (1, Ok(ObjectKind::DataWriter)));
        assert_eq!(
            ObjectId::new(0xabc, ObjectKind::Topic).to_bytes(),
            [0xab, 0xc2]
        );
        assert_eq!(ObjectId::CLIENT.kind(), Ok(ObjectKind::Client));
        assert_eq!(
            ObjectId::from_bytes([0, 9]).kind(),
            Err(WireError::UnknownKind(9))
        );
    }

    #[test]
    fn request_ids_skip_the_reserved_ones() {
        assert_eq!(RequestId(0).next(), RequestId(10));
        assert_eq!(RequestId(10).next(), RequestId(11));
        assert_eq!(RequestId(65535).next(), RequestId(10));
    }
}
