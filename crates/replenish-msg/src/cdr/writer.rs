//! Little-endian XCDR1 writing into a borrowed buffer.

use super::{CdrError, padding};

/// Appends CDR items to a buffer, each aligned relative to the buffer's start.
///
/// An item that does not fit is not begun, so [`len`](Self::len) always ends at an item.
#[derive(Debug)]
pub struct CdrWriter<'a> {
    buf: &'a mut [u8],
    pos: usize,
}

macro_rules! write_primitive {
    ($($name:ident: $ty:ty),*) => {$(
        #[doc = concat!("Writes one `", stringify!($ty), "`, aligned to its size.")]
        ///
        /// # Errors
        /// [`CdrError::EndOfBuffer`].
        pub fn $name(&mut self, value: $ty) -> Result<(), CdrError> {
            self.put(size_of::<$ty>(), &value.to_le_bytes())
        }
    )*};
}

impl<'a> CdrWriter<'a> {
    /// A writer whose payload starts at the start of `buf`.
    pub fn new(buf: &'a mut [u8]) -> Self {
        Self { buf, pos: 0 }
    }

    /// Bytes written so far, padding included.
    #[must_use]
    pub fn len(&self) -> usize {
        self.pos
    }

    /// Whether nothing has been written yet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pos == 0
    }

    /// The payload so far.
    #[must_use]
    pub fn written(&self) -> &[u8] {
        self.buf.get(..self.pos).unwrap_or_default()
    }

    write_primitive!(u8: u8, u16: u16, u32: u32, u64: u64, i8: i8, i16: i16, i32: i32, i64: i64, f32: f32, f64: f64);

    /// Writes one `bool` as a byte 0 or 1.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`].
    pub fn bool(&mut self, value: bool) -> Result<(), CdrError> {
        self.u8(u8::from(value))
    }

    /// Writes bytes as they are: a fixed-size `uint8` array, or the elements of a sequence.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`].
    pub fn bytes(&mut self, bytes: &[u8]) -> Result<(), CdrError> {
        replenish_wire::copy(self.room(1, bytes.len())?, bytes);
        Ok(())
    }

    /// Writes the number of elements of a sequence; the elements follow.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`]; [`CdrError::TooLong`] above `u32::MAX`.
    pub fn sequence(&mut self, len: usize) -> Result<(), CdrError> {
        self.u32(length(len)?)
    }

    /// Writes a string: length with NUL, contents, NUL.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`]; [`CdrError::TooLong`] above `u32::MAX`.
    pub fn string(&mut self, value: &str) -> Result<(), CdrError> {
        let start = self.pos;
        self.sequence(value.len().saturating_add(1))
            .and_then(|()| self.bytes(value.as_bytes()))
            .and_then(|()| self.u8(0))
            .inspect_err(|_| self.pos = start)
    }

    /// Makes room for `count` primitives of `size` bytes each (a power of two, at most 8), aligned,
    /// which the caller fills with little-endian bytes. No element, no padding.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`].
    pub fn primitives(&mut self, size: usize, count: usize) -> Result<&mut [u8], CdrError> {
        match count {
            0 => Ok(&mut []),
            _ => self.room(size, size.saturating_mul(count)),
        }
    }

    /// Writes zeros up to a multiple of `align`, then `bytes`; or nothing at all.
    fn put(&mut self, align: usize, bytes: &[u8]) -> Result<(), CdrError> {
        self.room(align, bytes.len())?.copy_from_slice(bytes);
        Ok(())
    }

    /// Writes zeros up to a multiple of `align`, then makes room for `len` bytes; or nothing at
    /// all.
    fn room(&mut self, align: usize, len: usize) -> Result<&mut [u8], CdrError> {
        let pad = padding(self.pos, align);
        let needed = pad.saturating_add(len);
        let available = self.buf.len().saturating_sub(self.pos);
        let end = CdrError::EndOfBuffer {
            at: self.pos,
            needed,
            available,
        };
        let room = self.buf.get_mut(self.pos..).unwrap_or_default();
        let (zeros, rest) = room.split_at_mut_checked(pad).ok_or(end)?;
        let (item, _) = rest.split_at_mut_checked(len).ok_or(end)?;
        zeros.fill(0);
        self.pos += needed;
        Ok(item)
    }
}

fn length(len: usize) -> Result<u32, CdrError> {
    u32::try_from(len).map_err(|_| CdrError::TooLong {
        len,
        limit: u32::MAX as usize,
    })
}
