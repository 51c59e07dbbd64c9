//! `std_msgs/msg/String` and `std_msgs/msg/Header`.

use crate::builtin_interfaces::Time;
use crate::cdr::max_string_size;
use crate::structure::known;
use crate::{CdrError, CdrReader, CdrWriter, Message};

/// `std_msgs/msg/String` of at most `N` bytes, 255 if not stated.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BoundedString<const N: usize = 255> {
    /// The text.
    pub data: heapless::String<N>,
}

impl<const N: usize> TryFrom<&str> for BoundedString<N> {
    type Error = CdrError;

    /// # Errors
    /// [`CdrError::TooLong`] above `N` bytes.
    fn try_from(text: &str) -> Result<Self, CdrError> {
        let mut message = Self::default();
        assign(&mut message.data, text)?;
        Ok(message)
    }
}

impl<const N: usize> Message for BoundedString<N> {
    const TYPE_NAME: &'static str = "std_msgs/msg/String";
    const DDS_TYPE_NAME: &'static str = "std_msgs::msg::dds_::String_";
    const MAX_SIZE: usize = max_string_size(N);
    known!(
        "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
        "std_msgs/msg/String",
        "data": One, Text(N)
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.string(&self.data)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        assign(&mut self.data, r.string(N)?)
    }
}

/// `std_msgs/msg/Header` with a `frame_id` of at most `N` bytes, 255 if not stated.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BoundedHeader<const N: usize = 255> {
    /// Time at which the data was taken.
    pub stamp: Time,
    /// The coordinate frame the data is in.
    pub frame_id: heapless::String<N>,
}

impl<const N: usize> Message for BoundedHeader<N> {
    const TYPE_NAME: &'static str = "std_msgs/msg/Header";
    const DDS_TYPE_NAME: &'static str = "std_msgs::msg::dds_::Header_";
    const MAX_SIZE: usize = Time::MAX_SIZE + max_string_size(N);
    known!(
        "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
        "std_msgs/msg/Header",
        "stamp": One, Nested(Time::STRUCTURE),
        "frame_id": One, Text(N)
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        self.stamp.encode(w)?;
        w.string(&self.frame_id)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.stamp.decode(r)?;
        assign(&mut self.frame_id, r.string(N)?)
    }
}

/// Replaces the contents of `field` by `text`.
pub(super) fn assign<const N: usize>(
    field: &mut heapless::String<N>,
    text: &str,
) -> Result<(), CdrError> {
    field.clear();
    field.push_str(text).map_err(|_| CdrError::TooLong {
        len: text.len(),
        limit: N,
    })
}
