//! Names of participants and endpoints (RTPS 2.5, 9.3.1).

use super::{Reader, WireError, Writer};
use core::fmt;

/// Number of a participant: 12 bytes, the first two its vendor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GuidPrefix(pub [u8; 12]);

/// Number of an entity in its participant: three bytes of key and one of kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EntityId(pub [u8; 4]);

impl EntityId {
    /// Every matching endpoint, or none in particular.
    pub const UNKNOWN: EntityId = EntityId([0; 4]);
    /// The participant itself.
    pub const PARTICIPANT: EntityId = EntityId([0, 0, 1, 0xc1]);
    /// Announces participants (SPDP).
    pub const SPDP_WRITER: EntityId = EntityId([0, 1, 0, 0xc2]);
    /// Hears announcements of participants.
    pub const SPDP_READER: EntityId = EntityId([0, 1, 0, 0xc7]);
    /// Announces writers (SEDP).
    pub const SEDP_PUBLICATIONS_WRITER: EntityId = EntityId([0, 0, 3, 0xc2]);
    /// Hears announcements of writers.
    pub const SEDP_PUBLICATIONS_READER: EntityId = EntityId([0, 0, 3, 0xc7]);
    /// Announces readers (SEDP).
    pub const SEDP_SUBSCRIPTIONS_WRITER: EntityId = EntityId([0, 0, 4, 0xc2]);
    /// Hears announcements of readers.
    pub const SEDP_SUBSCRIPTIONS_READER: EntityId = EntityId([0, 0, 4, 0xc7]);
    /// Asserts liveliness.
    pub const LIVELINESS_WRITER: EntityId = EntityId([0, 2, 0, 0xc2]);
    /// Hears assertions of liveliness.
    pub const LIVELINESS_READER: EntityId = EntityId([0, 2, 0, 0xc7]);

    /// A user's writer without key; `key` below 2^24.
    #[must_use]
    pub const fn writer(key: u32) -> Self {
        Self::with_kind(key, 0x03)
    }

    /// A user's reader without key; `key` below 2^24.
    #[must_use]
    pub const fn reader(key: u32) -> Self {
        Self::with_kind(key, 0x04)
    }

    const fn with_kind(key: u32, kind: u8) -> Self {
        let [_, a, b, c] = key.to_be_bytes();
        EntityId([a, b, c, kind])
    }

    const fn kind(self) -> u8 {
        let [_, _, _, kind] = self.0;
        kind
    }

    /// Whether the entity writes, with or without key.
    #[must_use]
    pub const fn is_writer(self) -> bool {
        matches!(self.kind() & 0x3f, 0x02 | 0x03)
    }

    /// Whether the entity reads, with or without key.
    #[must_use]
    pub const fn is_reader(self) -> bool {
        matches!(self.kind() & 0x3f, 0x04 | 0x07)
    }

    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        r.array().map(EntityId)
    }
}

/// Number of a participant and of its entity: 16 bytes, the *gid* of ROS 2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Guid {
    /// The participant.
    pub prefix: GuidPrefix,
    /// The entity.
    pub entity: EntityId,
}

impl Guid {
    /// `entity` of the participant `prefix`.
    #[must_use]
    pub const fn new(prefix: GuidPrefix, entity: EntityId) -> Self {
        Guid { prefix, entity }
    }

    /// The 16 bytes on the wire.
    #[must_use]
    pub fn to_bytes(self) -> [u8; 16] {
        let mut bytes = [0; 16];
        let parts = self.prefix.0.iter().chain(&self.entity.0);
        for (to, from) in bytes.iter_mut().zip(parts) {
            *to = *from;
        }
        bytes
    }

    /// Reads the 16 bytes.
    ///
    /// # Errors
    /// [`WireError::Truncated`].
    pub fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        Ok(Guid {
            prefix: GuidPrefix(r.array()?),
            entity: EntityId::decode(r)?,
        })
    }

    pub(super) fn encode(self, w: &mut Writer<'_>) {
        w.put(&self.prefix.0);
        w.put(&self.entity.0);
    }
}

impl fmt::Display for Guid {
    /// Hexadecimal, participant and entity parted by a bar.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for byte in self.prefix.0 {
            write!(f, "{byte:02x}")?;
        }
        f.write_str("|")?;
        for byte in self.entity.0 {
            write!(f, "{byte:02x}")?;
        }
        Ok(())
    }
}
