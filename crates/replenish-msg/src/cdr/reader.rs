//! XCDR1 reading, in either byte order, from untrusted bytes.

use super::{CdrError, padding};

/// The byte order of a payload, chosen by its sender.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Endianness {
    /// Least significant byte first; what every common sender uses.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

/// Takes CDR items from a buffer, each aligned relative to the buffer's start.
///
/// Every read is bounds-checked; a failed read takes nothing.
#[derive(Clone, Debug)]
pub struct CdrReader<'a> {
    buf: &'a [u8],
    pos: usize,
    order: Endianness,
}

macro_rules! read_primitive {
    ($($name:ident: $ty:ty),*) => {$(
        #[doc = concat!("Reads one `", stringify!($ty), "`, aligned to its size.")]
        ///
        /// # Errors
        /// [`CdrError::EndOfBuffer`].
        pub fn $name(&mut self) -> Result<$ty, CdrError> {
            let bytes = self.array()?;
            Ok(match self.order {
                Endianness::Little => <$ty>::from_le_bytes(bytes),
                Endianness::Big => <$ty>::from_be_bytes(bytes),
            })
        }
    )*};
}

impl<'a> CdrReader<'a> {
    /// A little-endian reader whose payload starts at the start of `buf`.
    #[must_use]
    pub fn new(buf: &'a [u8]) -> Self {
        Self::with_order(buf, Endianness::Little)
    }

    /// A reader of the given byte order whose payload starts at the start of `buf`.
    #[must_use]
    pub fn with_order(buf: &'a [u8], order: Endianness) -> Self {
        Self { buf, pos: 0, order }
    }

    /// A reader of a payload with its 4-byte encapsulation header in front, as DDS and bag files
    /// carry it (OMG DDSI-RTPS 2.5, clause 10.2): `00 00` is big-endian XCDR1, `00 01`
    /// little-endian. Offsets count from behind the header, and so does alignment.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`] below 4 bytes; [`CdrError::Encapsulation`] for another encoding.
    pub fn encapsulated(buf: &'a [u8]) -> Result<Self, CdrError> {
        let Some((header, payload)) = buf.split_first_chunk::<4>() else {
            let (needed, available) = (4, buf.len());
            return Err(CdrError::EndOfBuffer {
                at: 0,
                needed,
                available,
            });
        };
        match *header {
            [0, 0, ..] => Ok(Self::with_order(payload, Endianness::Big)),
            [0, 1, ..] => Ok(Self::with_order(payload, Endianness::Little)),
            [a, b, ..] => Err(CdrError::Encapsulation {
                id: u16::from_be_bytes([a, b]),
            }),
        }
    }

    /// The byte order of the payload.
    #[must_use]
    pub fn order(&self) -> Endianness {
        self.order
    }

    /// Bytes read so far, padding included.
    #[must_use]
    pub fn position(&self) -> usize {
        self.pos
    }

    /// Bytes that are left.
    #[must_use]
    pub fn remaining(&self) -> usize {
        self.buf.len().saturating_sub(self.pos)
    }

    read_primitive!(u8: u8, u16: u16, u32: u32, u64: u64, i8: i8, i16: i16, i32: i32, i64: i64, f32: f32, f64: f64);

    /// Reads one `bool`.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`]; [`CdrError::NotBool`] for a byte other than 0 and 1.
    pub fn bool(&mut self) -> Result<bool, CdrError> {
        let at = self.pos;
        match self.u8()? {
            0 => Ok(false),
            1 => Ok(true),
            value => {
                self.pos = at;
                Err(CdrError::NotBool { at, value })
            }
        }
    }

    /// Reads `len` bytes as they are: a fixed-size `uint8` array, or the elements of a sequence.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`].
    pub fn bytes(&mut self, len: usize) -> Result<&'a [u8], CdrError> {
        self.take(1, len)
    }

    /// Takes `count` primitives of `size` bytes each (a power of two, at most 8), aligned, in the
    /// payload's byte order. No element, no padding.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`].
    pub fn primitives(&mut self, size: usize, count: usize) -> Result<&'a [u8], CdrError> {
        match count {
            0 => Ok(&[]),
            _ => self.take(size, size.saturating_mul(count)),
        }
    }

    /// Reads the number of elements of a sequence of at most `limit` elements; they follow.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`]; [`CdrError::TooLong`] above `limit`.
    pub fn sequence(&mut self, limit: usize) -> Result<usize, CdrError> {
        let start = self.pos;
        let len = usize::try_from(self.u32()?).unwrap_or(usize::MAX);
        if len > limit {
            self.pos = start;
            return Err(CdrError::TooLong { len, limit });
        }
        Ok(len)
    }

    /// Reads a string of at most `limit` bytes, NUL not counted.
    ///
    /// A length of 0 is taken as the empty string: some senders leave out the NUL there.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`], [`CdrError::TooLong`], [`CdrError::NotTerminated`],
    /// [`CdrError::NotUtf8`].
    pub fn string(&mut self, limit: usize) -> Result<&'a str, CdrError> {
        let start = self.pos;
        self.string_from_here(limit)
            .inspect_err(|_| self.pos = start)
    }

    fn string_from_here(&mut self, limit: usize) -> Result<&'a str, CdrError> {
        let with_nul = usize::try_from(self.u32()?).unwrap_or(usize::MAX);
        let Some(len) = with_nul.checked_sub(1) else {
            return Ok("");
        };
        if len > limit {
            return Err(CdrError::TooLong { len, limit });
        }
        let at = self.pos;
        let Some((0, contents)) = self.bytes(with_nul)?.split_last() else {
            return Err(CdrError::NotTerminated { at: at + len });
        };
        core::str::from_utf8(contents).map_err(|e| CdrError::NotUtf8 {
            at: at + e.valid_up_to(),
        })
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], CdrError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, N)?);
        Ok(array)
    }

    /// Skips to a multiple of `align`, then takes `len` bytes; or nothing at all.
    fn take(&mut self, align: usize, len: usize) -> Result<&'a [u8], CdrError> {
        let pad = padding(self.pos, align);
        let needed = pad.saturating_add(len);
        let end = CdrError::EndOfBuffer {
            at: self.pos,
            needed,
            available: self.remaining(),
        };
        let item = self
            .buf
            .get(self.pos..)
            .and_then(|rest| rest.get(pad..needed))
            .ok_or(end)?;
        self.pos += needed;
        Ok(item)
    }
}
