//! `GET_INFO` and INFO, the protocol's ping: the agent's presence and its version.

use super::login::{COOKIE, Properties};
use super::{BaseRequest, ObjectKind, Reader, Status, WireError, Writer};
use super::{Encode, SubmessageId};

/// Bit of the `GET_INFO` mask: the configuration.
pub const INFO_CONFIGURATION: u32 = 0x1;
/// Bit of the `GET_INFO` mask: the activity, which eProsima's ping asks for.
pub const INFO_ACTIVITY: u32 = 0x2;

/// `GET_INFO`: asks about an object, usually [`ObjectId::AGENT`](super::ObjectId::AGENT).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GetInfo {
    /// The object.
    pub base: BaseRequest,
    /// The information to send.
    pub mask: u32,
}

impl Encode for GetInfo {
    fn id(&self) -> SubmessageId {
        SubmessageId::GetInfo
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.base.write(w);
        w.u32(self.mask);
    }
}

impl GetInfo {
    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        Ok(GetInfo {
            base: BaseRequest::decode(r)?,
            mask: r.u32()?,
        })
    }
}

/// The configuration of an agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AgentInfo {
    /// Protocol version, major and minor.
    pub version: [u8; 2],
    /// The vendor id of the agent.
    pub vendor: [u8; 2],
}

/// INFO: the answer to `GET_INFO`, as far as it is about an agent; what it says about other objects
/// is checked for its kind and skipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Info {
    /// The request that is answered.
    pub base: BaseRequest,
    /// Its outcome.
    pub status: Status,
    /// A number of the implementation's own; eProsima's agents leave it undefined.
    pub implementation: u8,
    /// The agent's configuration.
    pub agent: Option<AgentInfo>,
    /// The agent's activity: how available it is (1 from eProsima's).
    pub availability: Option<i16>,
}

impl Encode for Info {
    fn id(&self) -> SubmessageId {
        SubmessageId::Info
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.base.write(w);
        w.u8(self.status.0);
        w.u8(self.implementation);
        w.option(self.agent, |w, agent| {
            w.u8(ObjectKind::Agent.number());
            w.put(&COOKIE);
            w.put(&agent.version);
            w.put(&agent.vendor);
            w.bool(false); // no properties
        });
        w.option(self.availability, |w, availability| {
            w.u8(ObjectKind::Agent.number());
            w.i16(availability);
            w.u32(0); // no transport addresses
        });
    }
}

impl Info {
    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        let base = BaseRequest::decode(r)?;
        let (status, implementation) = (Status(r.u8()?), r.u8()?);
        let mut info = Info {
            base,
            status,
            implementation,
            agent: None,
            availability: None,
        };
        if r.bool()? {
            if ObjectKind::from_number(r.u8()?)? != ObjectKind::Agent {
                return Ok(info);
            }
            if r.array()? != COOKIE {
                return Err(WireError::BadCookie);
            }
            info.agent = Some(AgentInfo {
                version: r.array()?,
                vendor: r.array()?,
            });
            Properties::decode(r)?;
        }
        if r.bool()? && ObjectKind::from_number(r.u8()?)? == ObjectKind::Agent {
            info.availability = Some(r.i16()?);
            r.u32()?; // transport addresses follow; no agent sends any
        }
        Ok(info)
    }
}
