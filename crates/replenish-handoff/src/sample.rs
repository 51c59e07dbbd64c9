//! The facts about a sample besides its bytes; they travel with them through the inbox.

use super::Origins;

/// The facts about a sample besides its bytes.
///
/// Builds without feature `sample-info` keep [`arrival`](Self::arrival) alone while it waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SampleInfo {
    /// When its bytes reached this process (`CLOCK_MONOTONIC`), in nanoseconds.
    pub arrival: u64,
    /// When it was published, by the publisher's clock, in nanoseconds since the Unix epoch.
    /// DDS-XRCE agents do not tell.
    pub source_timestamp: Option<u64>,
    /// Its number among those of its writer. DDS-XRCE agents do not tell.
    pub sequence: Option<u64>,
    /// When it is of no use any more (`CLOCK_MONOTONIC`), in nanoseconds.
    pub expires: Option<u64>,
    /// Services: which request this is, or answers.
    pub request: RequestIdentity,
    /// The chains that led to it, where its publisher is in this process.
    pub origins: Origins,
}

impl SampleInfo {
    /// A sample of which only the arrival is known.
    #[must_use]
    pub const fn at(arrival: u64) -> Self {
        Self {
            arrival,
            source_timestamp: None,
            sequence: None,
            expires: None,
            request: RequestIdentity([0; 24]),
            origins: Origins::NONE,
        }
    }
}

/// Names one request of one client: what a middleware needs to route the reply back
/// (`SampleIdentity` of DDS-RPC: a GUID of 16 bytes and a number of 8).
///
/// With a *reply*, the last eight bytes are the number that
/// `Middleware::request` gave, big-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct RequestIdentity(pub [u8; 24]);

impl RequestIdentity {
    /// The identity with which a client gets the reply to its request `number`.
    #[must_use]
    pub const fn reply(number: u64) -> Self {
        Self::of([0; 16], number)
    }

    /// Request `number` of the client `guid`.
    #[must_use]
    pub const fn of(guid: [u8; 16], number: u64) -> Self {
        let mut bytes = [0; 24];
        let (a, b) = bytes.split_at_mut(16);
        a.copy_from_slice(&guid);
        b.copy_from_slice(&number.to_be_bytes());
        Self(bytes)
    }

    /// The client; zeros with replies.
    #[must_use]
    pub fn guid(&self) -> [u8; 16] {
        self.0.first_chunk().copied().unwrap_or_default()
    }

    /// The client's number of the request.
    #[must_use]
    pub fn number(&self) -> u64 {
        u64::from_be_bytes(self.0.last_chunk().copied().unwrap_or_default())
    }
}
