//! Building messages: the trait of bodies, measuring, appending submessages.

use super::header::SUBHEADER;
use super::{FLAG_LITTLE_ENDIAN, Header, SubmessageId, WireError, Writer, padding};

/// A submessage body that can be written.
pub trait Encode {
    /// The submessage of this body.
    fn id(&self) -> SubmessageId;

    /// Flag bits besides the byte order.
    fn flags(&self) -> u8 {
        0
    }

    /// Writes the body in little endian.
    fn write(&self, w: &mut Writer<'_>);

    /// The same with what [`Writer::check`] says then.
    ///
    /// # Errors
    /// [`WireError::NoRoom`], [`WireError::TooLong`], [`WireError::BadString`].
    fn encode(&self, w: &mut Writer<'_>) -> Result<(), WireError> {
        self.write(w);
        w.check()
    }

    /// Bytes of the body.
    ///
    /// # Errors
    /// [`WireError::TooLong`], [`WireError::BadString`].
    fn measure(&self) -> Result<usize, WireError> {
        let mut w = Writer::measuring();
        self.encode(&mut w)?;
        Ok(w.len())
    }

    /// Writes the submessage to the front of `room`, header and, if `pad`, padding included; gives
    /// its length. `None` if there is no room, or for what [`measure`](Self::measure) refuses.
    fn put_into(&self, room: &mut [u8], pad: bool) -> Option<usize> {
        let mut w = Writer::new(room);
        encode_submessage(self, pad, &mut w).ok()?;
        Some(w.len())
    }
}

/// A body in bytes: its head and its rest.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RawBody<'a> {
    pub(crate) id: SubmessageId,
    pub(crate) flags: u8,
    pub(crate) head: &'a [u8],
    pub(crate) rest: &'a [u8],
}

impl<'a> RawBody<'a> {
    /// A body of these bytes.
    pub(crate) const fn new(id: SubmessageId, bytes: &'a [u8]) -> Self {
        RawBody {
            id,
            flags: 0,
            head: bytes,
            rest: &[],
        }
    }

    /// A DELETE.
    pub(crate) const fn delete(base: &'a [u8; 4]) -> Self {
        RawBody::new(SubmessageId::Delete, base)
    }
}

impl Encode for RawBody<'_> {
    fn id(&self) -> SubmessageId {
        self.id
    }

    fn flags(&self) -> u8 {
        self.flags
    }

    fn write(&self, w: &mut Writer<'_>) {
        w.put(self.head);
        w.put(self.rest);
    }

    fn measure(&self) -> Result<usize, WireError> {
        Ok(self.head.len().wrapping_add(self.rest.len()))
    }

    fn put_into(&self, room: &mut [u8], pad: bool) -> Option<usize> {
        let len = self.head.len().wrapping_add(self.rest.len());
        let [low, high] = u16::try_from(len).ok()?.to_le_bytes();
        let head = [self.id as u8, self.flags | FLAG_LITTLE_ENDIAN, low, high];
        let padding = if pad { padding(len, 4) } else { 0 };
        let padding = [0; 4].get(..padding).unwrap_or_default();
        let mut written = 0_usize;
        for part in [&head, self.head, self.rest, padding] {
            let end = written.wrapping_add(part.len());
            room.get_mut(written..end)?.copy_from_slice(part);
            written = end;
        }
        Some(written)
    }
}

/// The length of a body on the wire.
///
/// # Errors
/// [`WireError::TooLong`], [`WireError::BadString`].
pub fn measure<B: Encode + ?Sized>(body: &B) -> Result<usize, WireError> {
    let len = body.measure()?;
    if len > usize::from(u16::MAX) {
        return Err(WireError::TooLong { len });
    }
    Ok(len)
}

/// The length of a submessage with its header and its padding to the next multiple of four.
///
/// # Errors
/// [`WireError::TooLong`], [`WireError::BadString`].
pub fn submessage_len<B: Encode + ?Sized>(body: &B) -> Result<usize, WireError> {
    let len = measure(body)?;
    Ok(len.wrapping_add(padding(len, 4)).wrapping_add(SUBHEADER))
}

/// Writes header, body and, if `pad`, zeros up to a multiple of four from the writer's start.
///
/// # Errors
/// [`WireError::NoRoom`], [`WireError::TooLong`], [`WireError::BadString`].
pub fn encode_submessage<B: Encode + ?Sized>(
    body: &B,
    pad: bool,
    w: &mut Writer<'_>,
) -> Result<(), WireError> {
    let len = measure(body)?;
    let [low, high] = u16::try_from(len)
        .map_err(|_| WireError::TooLong { len })?
        .to_le_bytes();
    let flags = body.flags() | FLAG_LITTLE_ENDIAN;
    w.put(&[body.id() as u8, flags, low, high]);
    w.body(|w| body.write(w));
    if pad {
        w.align(4);
    }
    w.check()
}

/// The length of a submessage that goes in fragments, with its header and its padding. A sample
/// longer than 65 535 bytes has none: it ends with its last fragment.
///
/// # Errors
/// [`WireError::TooLong`] for another submessage of that length, [`WireError::BadString`].
pub(crate) fn joined_len<B: Encode + ?Sized>(body: &B) -> Result<usize, WireError> {
    let len = body.measure()?;
    if is_unbounded(body.id(), len) {
        return Ok(len.saturating_add(SUBHEADER));
    }
    submessage_len(body)
}

/// Writes a submessage that goes in fragments; its length is [`joined_len`].
///
/// # Errors
/// [`WireError::NoRoom`], [`WireError::TooLong`], [`WireError::BadString`].
pub(crate) fn encode_joined<B: Encode + ?Sized>(
    body: &B,
    w: &mut Writer<'_>,
) -> Result<(), WireError> {
    if !is_unbounded(body.id(), body.measure()?) {
        return encode_submessage(body, true, w);
    }
    w.put(&[body.id() as u8, body.flags() | FLAG_LITTLE_ENDIAN, 0, 0]);
    w.body(|w| body.write(w));
    w.check()
}

/// Whether a submessage is a sample that its field for the length cannot hold.
fn is_unbounded(id: SubmessageId, len: usize) -> bool {
    id.is_sample() && len > usize::from(u16::MAX)
}

/// Appends a submessage to the message that the first `len` bytes of `buf` are, behind a gap up to
/// a multiple of four; gives the message's length then. `None`, and nothing is written, if there is
/// no room, or for what [`Encode::measure`] refuses.
pub(crate) fn append<B: Encode + ?Sized>(
    buf: &mut [u8],
    len: usize,
    body: &B,
    pad: bool,
) -> Option<usize> {
    let start = len.wrapping_add(padding(len, 4));
    let written = body.put_into(buf.get_mut(start..)?, pad)?;
    buf.get_mut(len..start)?.fill(0);
    Some(start.wrapping_add(written))
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
        let len = header.encode(buf)?;
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
    pub fn push<B: Encode + ?Sized>(&mut self, body: &B) -> Result<(), WireError> {
        self.append(body, false)
    }

    /// Like [`MessageWriter::push`], but pads the end to a multiple of four, as eProsima's client
    /// does on its streams.
    ///
    /// # Errors
    /// As [`MessageWriter::push`].
    pub fn push_padded<B: Encode + ?Sized>(&mut self, body: &B) -> Result<(), WireError> {
        self.append(body, true)
    }

    fn append<B: Encode + ?Sized>(&mut self, body: &B, pad: bool) -> Result<(), WireError> {
        if let Some(len) = append(self.buf, self.len, body, pad) {
            self.len = len;
            return Ok(());
        }
        let needed = submessage_len(body)?;
        let left = self.buf.len().saturating_sub(self.len);
        Err(WireError::NoRoom { needed, left })
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
