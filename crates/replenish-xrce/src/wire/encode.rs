//! Building messages: what a body must offer, measuring, appending submessages.

use super::message::{FLAG_LITTLE_ENDIAN, SUBHEADER};
use super::{Header, SubmessageId, WireError, Writer, padding};

/// A submessage body that can be written.
pub trait Encode {
    /// Which submessage it is the body of.
    fn id(&self) -> SubmessageId;

    /// Flag bits besides the byte order.
    fn flags(&self) -> u8 {
        0
    }

    /// Writes the body in little endian.
    ///
    /// # Errors
    /// [`WireError::NoRoom`], [`WireError::TooLong`], [`WireError::BadString`].
    fn encode(&self, w: &mut Writer<'_>) -> Result<(), WireError>;
}

/// The length of a body on the wire.
///
/// # Errors
/// [`WireError::TooLong`], [`WireError::BadString`].
pub fn measure(body: &dyn Encode) -> Result<usize, WireError> {
    let mut w = Writer::measuring();
    body.encode(&mut w)?;
    if w.len() > usize::from(u16::MAX) {
        return Err(WireError::TooLong { len: w.len() });
    }
    Ok(w.len())
}

/// The length of a submessage with its header and its padding to the next multiple of four.
///
/// # Errors
/// [`WireError::TooLong`], [`WireError::BadString`].
pub fn submessage_len(body: &dyn Encode) -> Result<usize, WireError> {
    let len = measure(body)?;
    Ok(len
        .saturating_add(padding(len, 4))
        .saturating_add(SUBHEADER))
}

/// Writes header, body and, if `pad`, zeros up to a multiple of four from the writer's start.
///
/// # Errors
/// [`WireError::NoRoom`], [`WireError::TooLong`], [`WireError::BadString`].
pub fn encode_submessage(
    body: &dyn Encode,
    pad: bool,
    w: &mut Writer<'_>,
) -> Result<(), WireError> {
    let len = measure(body)?;
    let length = u16::try_from(len).map_err(|_| WireError::TooLong { len })?;
    w.u8(body.id() as u8)?;
    w.u8(body.flags() | FLAG_LITTLE_ENDIAN)?;
    w.put(&length.to_le_bytes())?;
    w.body(|w| body.encode(w))?;
    if pad { w.align(4) } else { Ok(()) }
}

/// Builds a message in a buffer.
#[derive(Debug)]
pub struct MessageWriter<'a> {
    buf: &'a mut [u8],
    len: usize,
}

impl<'a> MessageWriter<'a> {
    /// Starts a message with its header.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn new(buf: &'a mut [u8], header: &Header) -> Result<Self, WireError> {
        let mut w = Writer::new(buf);
        header.encode(&mut w)?;
        let len = w.len();
        Ok(MessageWriter { buf, len })
    }

    /// Goes on with a message of which the first `len` bytes of `buf` are written.
    #[must_use]
    pub const fn resume(buf: &'a mut [u8], len: usize) -> Self {
        MessageWriter { buf, len }
    }

    /// Appends a submessage; nothing is written if it does not fit. The gap between submessages is
    /// filled, the end is not padded.
    ///
    /// # Errors
    /// [`WireError::NoRoom`], [`WireError::TooLong`], [`WireError::BadString`].
    pub fn push(&mut self, body: &dyn Encode) -> Result<(), WireError> {
        self.append(body, false)
    }

    /// Like [`MessageWriter::push`], but pads the end to a multiple of four, as eProsima's client
    /// does on its streams.
    ///
    /// # Errors
    /// As [`MessageWriter::push`].
    pub fn push_padded(&mut self, body: &dyn Encode) -> Result<(), WireError> {
        self.append(body, true)
    }

    fn append(&mut self, body: &dyn Encode, pad: bool) -> Result<(), WireError> {
        let gap = padding(self.len, 4);
        let no_room = WireError::NoRoom {
            needed: gap,
            left: 0,
        };
        let start = self.len.saturating_add(gap);
        let tail = self.buf.get_mut(start..).ok_or(no_room)?;
        let mut w = Writer::new(tail);
        encode_submessage(body, pad, &mut w)?;
        let written = w.len();
        if let Some(gap) = self.buf.get_mut(self.len..start) {
            gap.fill(0);
        }
        self.len = start.saturating_add(written);
        Ok(())
    }

    /// Bytes of the message so far.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.len
    }

    /// Whether there is not even a header.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The message.
    #[must_use]
    pub fn finish(self) -> &'a [u8] {
        let MessageWriter { buf, len } = self;
        buf.get(..len).unwrap_or(&[])
    }
}
