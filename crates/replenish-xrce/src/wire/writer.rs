//! [`Writer`]: CDR into a window.
//!
//! The writer shows a *window* of what is written: bytes before the window are skipped, bytes after
//! it are counted. That gives three things with one encoder: writing into a buffer, measuring
//! without a buffer, and cutting one submessage into fragments without an intermediate copy.

use super::{WireError, padding};

/// Writes little-endian CDR; alignment counts from where it was made (or from [`Writer::nested`]).
#[derive(Debug)]
pub struct Writer<'a> {
    window: &'a mut [u8],
    start: usize,
    pos: usize,
    origin: usize,
    strict: bool,
}

impl<'a> Writer<'a> {
    /// Writes to `buf`; more than fits is an error.
    pub const fn new(buf: &'a mut [u8]) -> Self {
        Writer {
            window: buf,
            start: 0,
            pos: 0,
            origin: 0,
            strict: true,
        }
    }

    /// Keeps only the bytes from position `start` on that fit into `buf`; the rest is counted.
    pub const fn window(buf: &'a mut [u8], start: usize) -> Self {
        Writer {
            window: buf,
            start,
            pos: 0,
            origin: 0,
            strict: false,
        }
    }

    /// Counts only.
    #[must_use]
    pub const fn measuring() -> Writer<'static> {
        Writer {
            window: &mut [],
            start: 0,
            pos: 0,
            origin: 0,
            strict: false,
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

    /// Appends `bytes` as they are.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn put(&mut self, bytes: &[u8]) -> Result<(), WireError> {
        let end = self.pos.saturating_add(bytes.len());
        if self.strict && end > self.window.len() {
            let left = self.window.len().saturating_sub(self.pos);
            return Err(WireError::NoRoom {
                needed: bytes.len(),
                left,
            });
        }
        // The part of `bytes` inside the window, which starts `skip` bytes in.
        let skip = self.start.saturating_sub(self.pos).min(bytes.len());
        let to = self.pos.saturating_add(skip).saturating_sub(self.start);
        let room = self.window.len().saturating_sub(to);
        let take = bytes.len().saturating_sub(skip).min(room);
        let src = bytes.get(skip..skip.saturating_add(take));
        let dst = self.window.get_mut(to..to.saturating_add(take));
        if let (Some(src), Some(dst)) = (src, dst) {
            dst.copy_from_slice(src);
        }
        self.pos = end;
        Ok(())
    }

    /// Zeros up to the next multiple of `to` (a power of two, at most 8).
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn align(&mut self, to: usize) -> Result<(), WireError> {
        let pad = padding(self.pos.wrapping_sub(self.origin), to);
        self.put([0; 8].get(..pad).unwrap_or(&[0; 8]))
    }

    /// One byte.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn u8(&mut self, value: u8) -> Result<(), WireError> {
        self.put(&[value])
    }

    /// A boolean as 0 or 1.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn bool(&mut self, value: bool) -> Result<(), WireError> {
        self.u8(u8::from(value))
    }

    /// An aligned 16-bit number.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn u16(&mut self, value: u16) -> Result<(), WireError> {
        self.align(2)?;
        self.put(&value.to_le_bytes())
    }

    /// An aligned signed 16-bit number.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn i16(&mut self, value: i16) -> Result<(), WireError> {
        self.u16(value.cast_unsigned())
    }

    /// An aligned 32-bit number.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn u32(&mut self, value: u32) -> Result<(), WireError> {
        self.align(4)?;
        self.put(&value.to_le_bytes())
    }

    /// A length-prefixed run of bytes.
    ///
    /// # Errors
    /// [`WireError::NoRoom`], [`WireError::TooLong`].
    pub fn bytes(&mut self, value: &[u8]) -> Result<(), WireError> {
        self.length(value.len())?;
        self.put(value)
    }

    /// A string with its terminating NUL.
    ///
    /// # Errors
    /// [`WireError::NoRoom`], [`WireError::TooLong`], [`WireError::BadString`] for a NUL inside.
    pub fn string(&mut self, value: &str) -> Result<(), WireError> {
        if value.as_bytes().contains(&0) {
            return Err(WireError::BadString);
        }
        self.length(value.len().saturating_add(1))?;
        self.put(value.as_bytes())?;
        self.u8(0)
    }

    /// A boolean that says whether there is a value, and then the value as `write` writes it.
    ///
    /// # Errors
    /// [`WireError::NoRoom`] and those of `write`.
    pub fn option<T>(
        &mut self,
        value: Option<T>,
        write: impl FnOnce(&mut Self, T) -> Result<(), WireError>,
    ) -> Result<(), WireError> {
        self.bool(value.is_some())?;
        value.map_or(Ok(()), |value| write(self, value))
    }

    /// A length-prefixed run that is CDR itself, with its own alignment origin. `write` is called
    /// twice, first to measure.
    ///
    /// # Errors
    /// [`WireError::NoRoom`], [`WireError::TooLong`] and those of `write`.
    pub fn nested(
        &mut self,
        write: &dyn Fn(&mut Writer<'_>) -> Result<(), WireError>,
    ) -> Result<(), WireError> {
        let mut measure = Writer::measuring();
        write(&mut measure)?;
        self.length(measure.len())?;
        self.body(|w| write(w))
    }

    /// A body with its own alignment origin.
    pub(super) fn body(
        &mut self,
        write: impl FnOnce(&mut Self) -> Result<(), WireError>,
    ) -> Result<(), WireError> {
        let outer = core::mem::replace(&mut self.origin, self.pos);
        let result = write(self);
        self.origin = outer;
        result
    }

    fn length(&mut self, len: usize) -> Result<(), WireError> {
        self.u32(u32::try_from(len).map_err(|_| WireError::TooLong { len })?)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Reader;
    use super::*;

    fn sample(w: &mut Writer<'_>) -> Result<(), WireError> {
        w.u8(1)?;
        w.u32(0x0403_0201)?;
        w.string("abc")?;
        w.nested(&|w| {
            w.u8(9)?;
            w.u16(0x0b0a)
        })
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
