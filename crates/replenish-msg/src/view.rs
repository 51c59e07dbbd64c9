//! Views: messages decoded without allocation, whose strings and sequences stay where they were.

use crate::wire::Item;
use crate::{CdrError, CdrReader, CdrWriter, DecodeError, Message, Structure, field_path};

/// A message that borrows from the bytes it was decoded from, or from what is to be encoded.
///
/// The generator makes a view `NameView` for each type `Name` that has unbounded fields; a type
/// without such fields is its own view. All bytes are checked when the view is made; elements of
/// sequences are decoded when one looks at them.
///
/// The constants are those of [`Message`] under other names, so that both traits can be in scope.
pub trait View<'a>: Item<'a> {
    /// The ROS name, such as `sensor_msgs/msg/Image`.
    const NAME: &'static str;
    /// The name of the same type in DDS.
    const DDS_NAME: &'static str;
    /// The type's hash, `RIHS01_` and 64 hexadecimal digits, if it is known.
    const HASH: Option<&'static str>;
    /// The fields.
    const FIELDS: &'static Structure;

    /// The message that `reader` has next.
    ///
    /// # Errors
    /// The field that cannot be decoded, and the reason.
    fn read(reader: &CdrReader<'a>) -> Result<Self, DecodeError> {
        Self::take(&mut reader.clone())
            .map_err(|error| DecodeError::find(Self::FIELDS, reader.clone(), error))
    }

    /// The message in a little-endian payload without encapsulation header, as DDS-XRCE carries
    /// it and as a subscription to raw bytes gets it.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    fn from_payload(payload: &'a [u8]) -> Result<Self, DecodeError> {
        Self::read(&CdrReader::new(payload))
    }

    /// The message in a payload with its 4-byte encapsulation header, of either byte order.
    ///
    /// # Errors
    /// As [`read`](Self::read); [`CdrError::Encapsulation`] for an encoding other than XCDR1.
    fn from_encapsulated(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        Self::read(&field_path::encapsulated(bytes, Self::FIELDS)?)
    }

    /// Encodes the message at the start of `buf` and returns the number of bytes used.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`] when `buf` is too short; [`CdrError::TooLong`] for a string or
    /// sequence above its bound.
    fn encode_to(&self, buf: &mut [u8]) -> Result<usize, CdrError> {
        let mut w = CdrWriter::new(buf);
        self.put(&mut w)?;
        Ok(w.len())
    }
}

/// A message whose view has a name.
pub trait Viewed: Message {
    /// The view: the type itself if it has no unbounded fields.
    type View<'a>: View<'a>;
}

impl<'a, M: Message> View<'a> for M {
    const NAME: &'static str = M::TYPE_NAME;
    const DDS_NAME: &'static str = M::DDS_TYPE_NAME;
    const HASH: Option<&'static str> = M::TYPE_HASH;
    const FIELDS: &'static Structure = M::STRUCTURE;
}
