//! Requests and replies of services: what stands before their payloads.
//!
//! ```text
//!   requester ── WRITE_DATA: request ──► agent ── DATA: identity, request ──► replier
//!   requester ◄── DATA: base, reply ──── agent ◄─ WRITE_DATA: identity, reply ── replier
//! ```
//!
//! The base before a reply names the `WRITE_DATA` that the request was.

use super::{BaseRequest, Encode, SubmessageId, Writer};

/// The sender and the number of a request (`SampleIdentity` of DDS-RPC): a GUID of 16 bytes and
/// a number of 8. A replier sends it back as it came.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SampleIdentity(pub [u8; 24]);

impl SampleIdentity {
    /// Splits the payload at a replier into identity and request.
    #[must_use]
    pub fn split(payload: &[u8]) -> Option<(SampleIdentity, &[u8])> {
        let (identity, rest) = payload.split_first_chunk()?;
        Some((SampleIdentity(*identity), rest))
    }
}

/// `WRITE_DATA` of a replier: a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteReply<'a> {
    /// The replier.
    pub base: BaseRequest,
    /// Identity of the request that is answered.
    pub identity: SampleIdentity,
    /// The reply.
    pub payload: &'a [u8],
}

impl Encode for WriteReply<'_> {
    fn id(&self) -> SubmessageId {
        SubmessageId::WriteData
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.base.write(w);
        w.put(&self.identity.0);
        w.put(self.payload);
    }
}
