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
    /// To be sent.
    List(&'a [(&'a str, &'a str)]),
    /// As received: checked, still encoded. See [`Properties::for_each`].
    Encoded {
        /// From the first pair on.
        bytes: &'a [u8],
        /// How many pairs.
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

    fn encode(self, w: &mut Writer<'_>) -> Result<(), WireError> {
        let Properties::None = self else {
            let (mut count, mut result) = (0_u32, Ok(()));
            self.for_each(|_, _| count = count.saturating_add(1));
            w.bool(true)?;
            w.u32(count)?;
            self.for_each(|name, value| {
                if result.is_ok() {
                    result = w.string(name).and_then(|()| w.string(value));
                }
            });
            return result;
        };
        w.bool(false)
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
    /// Who wrote the client.
    pub vendor: [u8; 2],
    /// Who the client is.
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

    fn encode(&self, w: &mut Writer<'_>) -> Result<(), WireError> {
        w.put(&COOKIE)?;
        w.put(&self.version)?;
        w.put(&self.vendor)?;
        w.put(&self.key.0)?;
        w.u8(self.session.0)?;
        self.properties.encode(w)?;
        w.u16(self.mtu)
    }
}

impl<'a> CreateClient<'a> {
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
    /// Who wrote the agent.
    pub vendor: [u8; 2],
    /// Optional properties.
    pub properties: Properties<'a>,
}

impl Encode for StatusAgent<'_> {
    fn id(&self) -> SubmessageId {
        SubmessageId::StatusAgent
    }

    fn encode(&self, w: &mut Writer<'_>) -> Result<(), WireError> {
        w.u8(self.status.0)?;
        w.u8(self.implementation)?;
        w.put(&COOKIE)?;
        w.put(&self.version)?;
        w.put(&self.vendor)?;
        self.properties.encode(w)
    }
}

impl<'a> StatusAgent<'a> {
    pub(super) fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
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

    fn encode(&self, w: &mut Writer<'_>) -> Result<(), WireError> {
        self.base.encode(w)?;
        w.u8(self.status.0)?;
        w.u8(self.implementation)
    }
}

impl StatusReply {
    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        Ok(StatusReply {
            base: BaseRequest::decode(r)?,
            status: Status(r.u8()?),
            implementation: r.u8()?,
        })
    }
}
