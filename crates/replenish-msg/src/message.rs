//! The traits of messages and services, with encoding and decoding.

use crate::{CdrError, CdrReader, CdrWriter, Structure};

/// A ROS 2 message: its names on the wire, and how it is encoded and decoded.
///
/// An implementation writes and reads the fields in the order of the `.msg` file and never
/// panics, whatever the bytes.
pub trait Message: Default + Send + 'static {
    /// The ROS name, such as `std_msgs/msg/Int32`.
    const TYPE_NAME: &'static str;

    /// The name of the same type in DDS, such as `std_msgs::msg::dds_::Int32_`.
    const DDS_TYPE_NAME: &'static str;

    /// Upper bound in bytes of one encoded message, without the encapsulation header.
    ///
    /// A buffer of this size is enough for any value if the type is [`BOUNDED`](Self::BOUNDED). Of
    /// a type that is not it is the size that buffers get unless one asks for another.
    const MAX_SIZE: usize;

    /// Whether no value takes more than [`MAX_SIZE`](Self::MAX_SIZE) bytes.
    const BOUNDED: bool = true;

    /// The type's hash, `RIHS01_` and 64 hexadecimal digits (ROS REP 2016), if it is known.
    const TYPE_HASH: Option<&'static str> = None;

    /// The fields, by which an error finds its [place](crate::field_path).
    const STRUCTURE: &'static Structure = &Structure::UNKNOWN;

    /// Appends this message to `w`.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`] when `w` has no room; never so if it had
    /// [`MAX_SIZE`](Self::MAX_SIZE) bytes. Bytes written before stay written.
    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError>;

    /// Replaces this value by the next message in `r`.
    ///
    /// Does not allocate if the type is [`BOUNDED`](Self::BOUNDED). Strings and sequences of other
    /// types keep their capacity: they grow until they have held the longest that came, and never
    /// by more than the bytes of `r` fill.
    ///
    /// # Errors
    /// Any [`CdrError`] when the bytes are not such a message. The value is then valid but
    /// unspecified: a mix of old and new fields.
    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError>;

    /// Makes room at set-up for messages of up to `bytes` bytes, in types that keep the bytes
    /// themselves. Others have nothing to do.
    fn reserve(&mut self, bytes: usize) {
        let _ = bytes;
    }
}

/// A ROS 2 service: a request and its response.
pub trait Service: 'static {
    /// The client's message.
    type Request: Message;
    /// The server's answer.
    type Response: Message;

    /// The ROS name, such as `example_interfaces/srv/AddTwoInts`.
    const TYPE_NAME: &'static str;

    /// The type's hash, `RIHS01_` and 64 hexadecimal digits (ROS REP 2016), if it is known.
    const TYPE_HASH: Option<&'static str> = None;
}

/// Encodes `msg` at the start of `buf` and returns the number of bytes used.
///
/// # Errors
/// [`CdrError::EndOfBuffer`] when `buf` is too short; [`Message::MAX_SIZE`] bytes are enough.
pub fn encode<M: Message>(msg: &M, buf: &mut [u8]) -> Result<usize, CdrError> {
    let mut w = CdrWriter::new(buf);
    msg.encode(&mut w)?;
    Ok(w.len())
}

/// Decodes the little-endian `payload` into `msg`.
///
/// Bytes behind the message are ignored: senders may pad, and a newer version of a type may
/// carry more fields.
///
/// # Errors
/// Any [`CdrError`] when the bytes are not such a message; see [`Message::decode`].
pub fn decode<M: Message>(msg: &mut M, payload: &[u8]) -> Result<(), CdrError> {
    msg.decode(&mut CdrReader::new(payload))
}
