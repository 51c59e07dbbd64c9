//! The identity of a request, which its reply carries back through the agent.
//!
//! On the wire, before each request to a replier and before each of its replies (`SampleIdentity`
//! of DDS-RPC): a GUID of 16 bytes, and a sequence number as a signed high and an unsigned low
//! half.

use replenish_xrce::wire::{ClientKey, ObjectId};

/// Identifies a requester among all requesters, past ones included.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Guid(pub(crate) [u8; 16]);

impl Guid {
    /// The GUID of requester `id` of client `key`, the `count`-th requester of agent `instance`:
    /// a late reply finds neither the successor of a requester nor that of an agent.
    pub(crate) fn new(key: ClientKey, id: ObjectId, count: u32, instance: u16) -> Self {
        let [k0, k1, k2, k3] = key.0;
        let [c0, c1, c2, c3] = count.to_le_bytes();
        let [i0, i1] = instance.to_le_bytes();
        let [o0, o1] = id.to_bytes();
        let [v0, v1] = replenish_xrce::wire::VENDOR;
        // The last byte is the RTPS kind of a writer without key.
        Self([
            v0, v1, k0, k1, k2, k3, i0, i1, c0, c1, c2, c3, 0, o0, o1, 0x03,
        ])
    }
}

/// One request of one requester; the first one has number 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Identity {
    pub(crate) guid: Guid,
    pub(crate) seq: u64,
}

impl Identity {
    /// Bytes on the wire.
    pub(crate) const LEN: usize = 24;

    pub(crate) fn to_bytes(self) -> [u8; Self::LEN] {
        let mut bytes = [0; Self::LEN];
        let (guid, seq) = bytes.split_at_mut(16);
        guid.copy_from_slice(&self.guid.0);
        let (high, low) = seq.split_at_mut(4);
        high.copy_from_slice(&((self.seq >> 32) as u32).to_le_bytes());
        low.copy_from_slice(&(self.seq as u32).to_le_bytes());
        bytes
    }

    /// Splits a replier's payload into the identity of the request and the reply.
    pub(crate) fn split(payload: &[u8]) -> Option<(Self, &[u8])> {
        let (guid, rest) = payload.split_first_chunk::<16>()?;
        let (high, rest) = rest.split_first_chunk::<4>()?;
        let (low, rest) = rest.split_first_chunk::<4>()?;
        let (high, low) = (u32::from_le_bytes(*high), u32::from_le_bytes(*low));
        let seq = (u64::from(high) << 32) | u64::from(low);
        let guid = Guid(*guid);
        Some((Self { guid, seq }, rest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use replenish_xrce::wire::ObjectKind;

    #[test]
    fn an_identity_looks_as_it_does_on_the_wire() {
        let id = ObjectId::new(1, ObjectKind::Requester);
        let guid = Guid::new(ClientKey([0xaa; 4]), id, 1, 0x0203);
        let identity = Identity {
            guid,
            seq: 0x0000_0001_0000_0002,
        };
        let bytes = identity.to_bytes();
        assert_eq!(
            bytes,
            [
                1, 0x0f, 0xaa, 0xaa, 0xaa, 0xaa, 3, 2, 1, 0, 0, 0, 0, 0, 0x17, 3, 1, 0, 0, 0, 2, 0,
                0, 0
            ]
        );
        let payload = [&bytes[..], b"reply"].concat();
        assert_eq!(Identity::split(&payload), Some((identity, &b"reply"[..])));
        assert_eq!(Identity::split(&payload[..23]), None);
    }
}
