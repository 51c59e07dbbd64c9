//! The `unique_identifier_msgs` package.

use crate::structure::known;
use crate::{CdrError, CdrReader, CdrWriter, Message, Viewed};
use core::fmt;

/// `unique_identifier_msgs/msg/UUID`: sixteen bytes that are unique.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct UUID {
    /// The bytes, most significant first.
    pub uuid: [u8; 16],
}

impl fmt::Display for UUID {
    /// As RFC 9562 writes it: `f81d4fae-7dec-11d0-a765-00a0c91e6bf6`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, byte) in self.uuid.iter().enumerate() {
            if matches!(i, 4 | 6 | 8 | 10) {
                f.write_str("-")?;
            }
            write!(f, "{byte:02x}")?;
        }
        Ok(())
    }
}

impl Message for UUID {
    const TYPE_NAME: &'static str = "unique_identifier_msgs/msg/UUID";
    const DDS_TYPE_NAME: &'static str = "unique_identifier_msgs::msg::dds_::UUID_";
    const MAX_SIZE: usize = 16;
    known!(
        "1b8e8aca958cbea28fe6ef60bf6c19b683c97a9ef60bb34752067d0f2f7ab437",
        "unique_identifier_msgs/msg/UUID",
        "uuid": Array(16), Number(1)
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.bytes(&self.uuid)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.uuid.copy_from_slice(r.bytes(16)?);
        Ok(())
    }
}

impl Viewed for UUID {
    type View<'a> = Self;
}
