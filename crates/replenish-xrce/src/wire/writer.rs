//! [`Writer`]: CDR into a window.
//!
//! The writer shows a *window* of what is written: bytes before the window are skipped, bytes after
//! it are counted. That gives three things with one encoder: writing into a buffer, measuring
//! without a buffer, and cutting one submessage into fragments without an intermediate copy.

use super::{WireError, padding};

/// Writes little-endian CDR; alignment counts from where it was made (or from [`Writer::nested`]).
///
/// The first error is kept until [`Writer::check`] returns it; nothing is written after it.
#[derive(Debug)]
pub struct Writer<'a> {
    window: &'a mut [u8],
    start: usize,
    pos: usize,
    origin: usize,
    strict: bool,
    error: Option<WireError>,
}

impl<'a> Writer<'a> {
    /// Writes to `buf`; more than fits is an error.
    pub const fn new(buf: &'a mut [u8]) -> Self {
        Self::make(buf, 0, true)
    }

    /// Keeps only the bytes from position `start` on that fit into `buf`; the rest is counted.
    pub const fn window(buf: &'a mut [u8], start: usize) -> Self {
        Self::make(buf, start, false)
    }

    /// Counts only.
    #[must_use]
    pub const fn measuring() -> Writer<'static> {
        Writer::make(&mut [], 0, false)
    }

    const fn make(window: &'a mut [u8], start: usize, strict: bool) -> Self {
        Writer {
            window,
            start,
            pos: 0,
            origin: 0,
            strict,
            error: None,
        }
    }

    /// Bytes written (or counted) so far.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.pos
    }

    /// Whether nothing was written yet.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.pos == 0
    }

    /// Whether everything was written.
    ///
    /// # Errors
    /// The first error: [`WireError::NoRoom`], [`WireError::TooLong`] or
    /// [`WireError::BadString`].
    pub const fn check(&self) -> Result<(), WireError> {
        match self.error {
            None => Ok(()),
            Some(error) => Err(error),
        }
    }

    const fn fail(&mut self, error: WireError) {
        if self.error.is_none() {
            self.error = Some(error);
        }
    }

    /// Appends `bytes` as they are.
    #[cfg_attr(not(feature = "std"), inline(never))]
    pub fn put(&mut self, bytes: &[u8]) {
        let end = self.pos.wrapping_add(bytes.len());
        if self.strict && end > self.window.len() {
            let left = self.window.len().saturating_sub(self.pos);
            self.fail(WireError::NoRoom {
                needed: bytes.len(),
                left,
            });
        }
        if self.error.is_none() {
            self.show(self.pos, bytes);
            self.pos = end;
        }
    }

    /// Copies the part of `bytes`, at position `at`, that is inside of the window.
    fn show(&mut self, at: usize, bytes: &[u8]) {
        // The part of `bytes` inside the window starts `skip` bytes in.
        let skip = self.start.saturating_sub(at);
        let room = self.window.get_mut(at.saturating_sub(self.start)..);
        let shown = bytes.iter().skip(skip);
        for (to, from) in room.unwrap_or_default().iter_mut().zip(shown) {
            *to = *from;
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

    /// A boolean as 0 or 1.
    pub fn bool(&mut self, value: bool) {
        self.u8(u8::from(value));
    }

    /// An aligned 16-bit number.
    pub fn u16(&mut self, value: u16) {
        self.align(2);
        self.put(&value.to_le_bytes());
    }

    /// An aligned signed 16-bit number.
    pub fn i16(&mut self, value: i16) {
        self.u16(value.cast_unsigned());
    }

    /// An aligned 32-bit number.
    pub fn u32(&mut self, value: u32) {
        self.align(4);
        self.put(&value.to_le_bytes());
    }

    /// A length-prefixed run of bytes.
    pub fn bytes(&mut self, value: &[u8]) {
        self.length(value.len());
        self.put(value);
    }

    /// A string with its terminating NUL; one inside is a [`WireError::BadString`].
    pub fn string(&mut self, value: &str) {
        if value.bytes().any(|byte| byte == 0) {
            self.fail(WireError::BadString);
        }
        self.length(value.len().wrapping_add(1));
        self.put(value.as_bytes());
        self.u8(0);
    }

    /// A boolean that says whether there is a value, and then the value as `write` writes it.
    pub fn option<T>(&mut self, value: Option<T>, write: impl FnOnce(&mut Self, T)) {
        self.bool(value.is_some());
        if let Some(value) = value {
            write(self, value);
        }
    }

    /// A length-prefixed run that is CDR itself, with its own alignment origin.
    pub fn nested(&mut self, write: impl FnOnce(&mut Self)) {
        let outer = self.open();
        write(self);
        self.close(outer);
    }

    /// Begins a nested run, with a length to be filled in; returns the origin outside of it.
    fn open(&mut self) -> usize {
        self.u32(0);
        core::mem::replace(&mut self.origin, self.pos)
    }

    /// Ends a nested run: its length is known.
    fn close(&mut self, outer: usize) {
        let start = core::mem::replace(&mut self.origin, outer);
        let len = self.pos.saturating_sub(start);
        match u32::try_from(len) {
            Ok(len) if self.error.is_none() => {
                self.show(start.saturating_sub(4), &len.to_le_bytes());
            }
            Ok(_) => {}
            Err(_) => self.fail(WireError::TooLong { len }),
        }
    }

    /// A body with its own alignment origin.
    pub(super) fn body(&mut self, write: impl FnOnce(&mut Self)) {
        let outer = core::mem::replace(&mut self.origin, self.pos);
        write(self);
        self.origin = outer;
    }

    fn length(&mut self, len: usize) {
        match u32::try_from(len) {
            Ok(len) => self.u32(len),
            Err(_) => self.fail(WireError::TooLong { len }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Reader;
    use super::*;

    fn sample(w: &mut Writer<'_>) -> Result<(), WireError> {
        w.u8(1);
        w.u32(0x0403_0201);
        w.string("abc");
        w.nested(|w| {
            w.u8(9);
            w.u16(0x0b0a);
        });
        w.check()
    }

    #[test]
    fn every_window_shows_its_part_of_the_whole() {
        let mut whole = [0; 64];
        let mut w = Writer::new(&mut whole);
        sample(&mut w).unwrap();
        let len = w.len();
        assert_eq!(
            &whole[..len],
            [
                1, 0, 0, 0, 1, 2, 3, 4, 4, 0, 0, 0, b'a', b'b', b'c', 0, 4, 0, 0, 0, 9, 0, 10, 11
            ]
        );
        for start in 0..=len {
            for size in 0..=len {
                let mut part = [0xee; 64];
                let mut w = Writer::window(&mut part[..size], start);
                sample(&mut w).unwrap();
                assert_eq!(w.len(), len);
                let shown = size.min(len - start);
                assert_eq!(part[..shown], whole[start..start + shown]);
                assert!(part[shown..].iter().all(|&b| b == 0xee));
            }
        }
    }

    #[test]
    fn a_short_buffer_is_an_error_and_a_short_input_too() {
        let mut buf = [0; 24];
        sample(&mut Writer::new(&mut buf)).unwrap();
        for short in 0..24 {
            let error = sample(&mut Writer::new(&mut buf[..short])).unwrap_err();
            assert!(
                matches!(error, WireError::NoRoom { .. }),
                "{short}: {error}"
            );
        }
        sample(&mut Writer::new(&mut buf)).unwrap();
        for short in 0..16 {
            let mut r = Reader::new(&buf[..short], true);
            let read = r.u8().and_then(|_| r.u32()).and_then(|_| r.string());
            assert!(matches!(read, Err(WireError::Truncated { .. })), "{short}");
        }
    }
}
