//! `CREATE_CLIENT`, `STATUS_AGENT` and STATUS: how a session begins, and the answer to requests.

use super::{BaseRequest, ClientKey, Reader, SessionId, Status, WireError, Writer};
use super::{Encode, SubmessageId};

/// The four bytes that begin a log-in.
pub const COOKIE: [u8; 4] = *b"XRCE";
/// Protocol version 1.0.
pub const VERSION: [u8; 2] = [1, 0];
/// The vendor id that eProsima's client and agent announce and expect.
pub const VENDOR: [u8; 2] = [0x01, 0x0f];

/// The properties of a log-in: pairs of name and value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Properties<'a> {
    /// Not sent.
    #[default]
    None,
    /// Pairs to send.
    List(&'a [(&'a str, &'a str)]),
    /// Pairs as received: checked, still encoded. See [`Properties::for_each`].
    Encoded {
        /// The bytes from the first pair on.
        bytes: &'a [u8],
        /// Number of pairs.
        count: u32,
        /// Byte order.
        little_endian: bool,
    },
}

impl<'a> Properties<'a> {
    /// Calls `f` with each name and value.
    pub fn for_each(&self, mut f: impl FnMut(&'a str, &'a str)) {
        match *self {
            Properties::None => {}
            Properties::List(list) => list.iter().for_each(|&(name, value)| f(name, value)),
            Properties::Encoded {
                bytes,
                count,
                little_endian,
            } => {
                let mut r = Reader::new(bytes, little_endian);
                for _ in 0..count {
                    let (Ok(name), Ok(value)) = (r.string(), r.string()) else {
                        return;
                    };
                    f(name, value);
                }
            }
        }
    }

    fn write(self, w: &mut Writer<'_>) {
        let Properties::None = self else {
            let mut count = 0_u32;
            self.for_each(|_, _| count = count.saturating_add(1));
            w.bool(true);
            w.u32(count);
            self.for_each(|name, value| {
                w.string(name);
                w.string(value);
            });
            return;
        };
        w.bool(false);
    }

    pub(super) fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
        if !r.bool()? {
            return Ok(Properties::None);
        }
        let count = r.u32()?;
        let bytes = r.clone().rest();
        for _ in 0..count {
            r.string()?;
            r.string()?;
        }
        Ok(Properties::Encoded {
            bytes,
            count,
            little_endian: r.little_endian(),
        })
    }
}

/// `CREATE_CLIENT`: asks the agent for a session. Sent outside of any session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CreateClient<'a> {
    /// Protocol version, major and minor.
    pub version: [u8; 2],
    /// The vendor id of the client.
    pub vendor: [u8; 2],
    /// The client's key.
    pub key: ClientKey,
    /// The session to create.
    pub session: SessionId,
    /// Optional properties.
    pub properties: Properties<'a>,
    /// The longest message the client takes, in bytes.
    pub mtu: u16,
}

impl Encode for CreateClient<'_> {
    fn id(&self) -> SubmessageId {
        SubmessageId::CreateClient
    }

    fn write(&self, w: &mut Writer<'_>) {
        w.put(&COOKIE);
        w.put(&self.version);
        w.put(&self.vendor);
        w.put(&self.key.0);
        w.u8(self.session.0);
        self.properties.write(w);
        w.u16(self.mtu);
    }
}

impl<'a> CreateClient<'a> {
    /// The body of one without properties.
    pub(crate) const fn plain(key: ClientKey, session: SessionId, mtu: u16) -> [u8; 16] {
        let ([a, b, c, d], [e, f]) = (key.0, mtu.to_le_bytes());
        let [major, minor] = VERSION;
        let [high, low] = VENDOR;
        let [x, r, m, p] = COOKIE;
        [
            x, r, m, p, major, minor, high, low, a, b, c, d, session.0, 0, e, f,
        ]
    }

    pub(super) fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
        if r.array()? != COOKIE {
            return Err(WireError::BadCookie);
        }
        Ok(CreateClient {
            version: r.array()?,
            vendor: r.array()?,
            key: ClientKey(r.array()?),
            session: SessionId(r.u8()?),
            properties: Properties::decode(r)?,
            mtu: r.u16()?,
        })
    }
}

/// `STATUS_AGENT`: the agent's answer to `CREATE_CLIENT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StatusAgent<'a> {
    /// Whether the session exists now.
    pub status: Status,
    /// A number of the implementation's own.
    pub implementation: u8,
    /// Protocol version, major and minor.
    pub version: [u8; 2],
    /// The vendor id of the agent.
    pub vendor: [u8; 2],
    /// Optional properties.
    pub properties: Properties<'a>,
}

impl Encode for StatusAgent<'_> {
    fn id(&self) -> SubmessageId {
        SubmessageId::StatusAgent
    }

    fn write(&self, w: &mut Writer<'_>) {
        w.u8(self.status.0);
        w.u8(self.implementation);
        w.put(&COOKIE);
        w.put(&self.version);
        w.put(&self.vendor);
        self.properties.write(w);
    }
}

impl<'a> StatusAgent<'a> {
    /// The outcome alone; `None` if the body is too short or of no answer to a log-in.
    pub(crate) fn outcome(body: &[u8]) -> Option<Status> {
        let fixed: &[u8; 11] = body.first_chunk()?;
        let &[status, _, a, b, c, d, ..] = fixed;
        ([a, b, c, d] == COOKIE).then_some(Status(status))
    }

    pub(crate) fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
        let (status, implementation) = (Status(r.u8()?), r.u8()?);
        if r.array()? != COOKIE {
            return Err(WireError::BadCookie);
        }
        Ok(StatusAgent {
            status,
            implementation,
            version: r.array()?,
            vendor: r.array()?,
            properties: Properties::decode(r)?,
        })
    }
}

/// STATUS: the agent's answer to CREATE and DELETE.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StatusReply {
    /// The request that is answered.
    pub base: BaseRequest,
    /// Its outcome.
    pub status: Status,
    /// A number of the implementation's own.
    pub implementation: u8,
}

impl Encode for StatusReply {
    fn id(&self) -> SubmessageId {
        SubmessageId::Status
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.base.write(w);
        w.u8(self.status.0);
        w.u8(self.implementation);
    }
}

impl StatusReply {
    /// Reads it from a body; `None` if that is too short.
    pub(crate) fn of(body: &[u8]) -> Option<Self> {
        let &[a, b, c, d, status, implementation] = body.first_chunk()?;
        Some(StatusReply {
            base: BaseRequest::from_bytes([a, b, c, d]),
            status: Status(status),
            implementation,
        })
    }

    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        let body = r.rest();
        let (needed, left) = (6, body.len());
        Self::of(body).ok_or(WireError::Truncated { needed, left })
    }
}
