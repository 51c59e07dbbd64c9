//! [`Writer`]: little-endian CDR into a buffer.

use super::WireError;
use replenish_wire::padding;

/// Writes little-endian CDR; alignment counts from the buffer's start or the last
/// [`Writer::set_origin`].
///
/// The first error is kept until [`Writer::finish`] returns it; nothing is written after it.
#[derive(Debug)]
pub struct Writer<'a> {
    buf: &'a mut [u8],
    pos: usize,
    origin: usize,
    /// Nothing is written behind it, even if there is room.
    limit: usize,
    error: Option<WireError>,
}

impl<'a> Writer<'a> {
    /// Writes to `buf`; more than fits is an error.
    pub const fn new(buf: &'a mut [u8]) -> Self {
        Writer {
            buf,
            pos: 0,
            origin: 0,
            limit: usize::MAX,
            error: None,
        }
    }

    /// Bytes written so far.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.pos
    }

    /// Whether nothing was written yet.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.pos == 0
    }

    /// Alignment counts from here on.
    pub const fn set_origin(&mut self) {
        self.origin = self.pos;
    }

    /// The bytes that were written.
    ///
    /// # Errors
    /// The first error: [`WireError::NoRoom`] or [`WireError::TooLong`].
    pub fn finish(self) -> Result<&'a [u8], WireError> {
        match self.error {
            None => Ok(self.buf.get(..self.pos).unwrap_or(&[])),
            Some(error) => Err(error),
        }
    }

    /// The bytes that were written so far.
    #[must_use]
    pub fn written(&self) -> &[u8] {
        self.buf.get(..self.pos).unwrap_or(&[])
    }

    /// The first error, which is forgotten together with everything after `to`.
    pub(super) fn roll_back(&mut self, to: usize) -> Option<WireError> {
        let error = self.error.take();
        if error.is_some() {
            self.pos = to.min(self.pos);
        }
        error
    }

    pub(super) const fn limit(&mut self, to: usize) {
        self.limit = to;
    }

    pub(super) fn truncate(&mut self, to: usize) {
        self.pos = to.min(self.pos);
    }

    pub(super) const fn fail(&mut self, error: WireError) {
        if self.error.is_none() {
            self.error = Some(error);
        }
    }

    /// Appends `bytes` as they are.
    pub fn put(&mut self, bytes: &[u8]) {
        if self.error.is_some() {
            return;
        }
        let end = self.pos.saturating_add(bytes.len());
        let limit = self.limit;
        let room = self.buf.get_mut(self.pos..end);
        match room.filter(|_| end <= limit) {
            Some(room) => {
                replenish_wire::copy(room, bytes);
                self.pos = end;
            }
            None => self.fail(WireError::NoRoom {
                needed: bytes.len(),
                left: self.buf.len().min(limit).saturating_sub(self.pos),
            }),
        }
    }

    /// Zeros up to the next multiple of `to` (a power of two, at most 8).
    pub fn align(&mut self, to: usize) {
        let pad = padding(self.pos.wrapping_sub(self.origin), to);
        self.put([0; 8].get(..pad).unwrap_or(&[0; 8]));
    }

    /// One byte.
    pub fn u8(&mut self, value: u8) {
        self.put(&[value]);
    }

    /// An aligned 16-bit number.
    pub fn u16(&mut self, value: u16) {
        self.align(2);
        self.put(&value.to_le_bytes());
    }

    /// An aligned 32-bit number.
    pub fn u32(&mut self, value: u32) {
        self.align(4);
        self.put(&value.to_le_bytes());
    }

    /// An aligned signed 32-bit number.
    pub fn i32(&mut self, value: i32) {
        self.u32(value.cast_unsigned());
    }

    /// A length-prefixed run of bytes, at most 4 GiB.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.u32(u32::try_from(bytes.len()).unwrap_or(u32::MAX));
        self.put(bytes);
    }

    /// A string with its terminating NUL.
    pub fn string(&mut self, text: &str) {
        self.u32(u32::try_from(text.len().saturating_add(1)).unwrap_or(u32::MAX));
        self.put(text.as_bytes());
        self.u8(0);
    }

    /// Writes the 16-bit number at `at` again. Not after an error: the number was not written then,
    /// and its place belongs to an earlier one.
    pub(super) fn patch_u16(&mut self, at: usize, value: usize) {
        if self.error.is_some() {
            return;
        }
        let Ok(value) = u16::try_from(value) else {
            return self.fail(WireError::TooLong { len: value });
        };
        if let Some(room) = self.buf.get_mut(at..at.saturating_add(2)) {
            room.copy_from_slice(&value.to_le_bytes());
        }
    }
}
