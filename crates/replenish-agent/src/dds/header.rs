//! The identities of requests and replies, in both forms.
//!
//! - `rmw_cyclonedds` puts a header before the message, of 16 bytes, so that the message keeps its
//!   alignment: 8 that name the client, and a signed 64-bit sequence number, both little-endian.
//! - `rmw_fastrtps` and others send an identity beside it, as DDS-RPC's enhanced mapping has it.
//!
//! Plain bytes and numbers alone: `fuzz/targets/services.rs` compiles this file.

/// The first two bytes of the GUIDs of Eclipse Cyclone DDS: its vendor id, where DDSI-RTPS 2.2 and
/// later (9.3.1.5) put it.
const CYCLONE: [u8; 2] = [0x01, 0x10];

/// Bytes of the header.
pub(crate) const LEN: usize = 16;

/// The header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Header {
    pub(crate) client: [u8; 8],
    pub(crate) sequence: i64,
}

impl Header {
    /// The header and the message after it.
    pub(crate) fn before(self, payload: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(LEN + payload.len());
        bytes.extend(self.client);
        bytes.extend(self.sequence.to_le_bytes());
        bytes.extend(payload);
        bytes
    }

    /// The header, and the message in place of both.
    pub(crate) fn split(payload: &mut Vec<u8>) -> Option<Self> {
        let (client, rest) = payload.split_first_chunk::<8>()?;
        let sequence = i64::from_le_bytes(*rest.first_chunk::<8>()?);
        let client = *client;
        payload.drain(..LEN);
        Some(Self { client, sequence })
    }
}

/// Whether a participant is Cyclone's, by the prefix of its GUIDs.
pub(crate) fn is_cyclone(prefix: &[u8]) -> bool {
    prefix.starts_with(&CYCLONE)
}

/// A GUID and a sequence number.
pub(crate) type Identity = ([u8; 16], i64);

/// The identity that the reply to a request goes to: the request's own, unless it says another.
/// `rmw_fastrtps` says the reader that waits for the reply, and leaves the number open.
pub(crate) fn enhanced(own: Identity, related: Option<Identity>) -> Identity {
    let Some((guid, number)) = related.filter(|(guid, _)| *guid != [0; 16]) else {
        return own;
    };
    (guid, if number <= 0 { own.1 } else { number })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_and_back() {
        let header = Header {
            client: *b"whoever!",
            sequence: 0x0102,
        };
        let mut bytes = header.before(b"ask");
        assert_eq!(bytes, b"whoever!\x02\x01\0\0\0\0\0\0ask");
        assert_eq!(Header::split(&mut bytes), Some(header));
        assert_eq!(bytes, b"ask");
        assert_eq!(Header::split(&mut vec![0; 15]), None);
    }
}
