//! [`Reader`]: a bounds-checked cursor over received CDR.

use super::WireError;

/// Reads CDR from a slice; alignment counts from the slice's start.
#[derive(Clone, Copy, Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    pos: usize,
    little: bool,
}

impl<'a> Reader<'a> {
    /// A reader at the start of `bytes`.
    #[must_use]
    pub const fn new(bytes: &'a [u8], little_endian: bool) -> Self {
        Reader {
            bytes,
            pos: 0,
            little: little_endian,
        }
    }

    /// Whether multi-byte numbers are little endian.
    #[must_use]
    pub const fn little_endian(&self) -> bool {
        self.little
    }

    /// Bytes that are left.
    #[must_use]
    pub const fn left(&self) -> usize {
        self.bytes.len().saturating_sub(self.pos)
    }

    /// The next `n` bytes, without alignment.
    ///
    /// # Errors
    /// [`WireError::Truncated`] if fewer are left.
    pub fn take(&mut self, n: usize) -> Result<&'a [u8], WireError> {
        let rest = self.bytes.get(self.pos..).unwrap_or(&[]);
        let Some((head, _)) = rest.split_at_checked(n) else {
            return Err(WireError::Truncated {
                needed: n,
                left: rest.len(),
            });
        };
        self.pos = self.pos.saturating_add(n);
        Ok(head)
    }

    /// Everything that is left.
    pub fn rest(&mut self) -> &'a [u8] {
        let rest = self.bytes.get(self.pos..).unwrap_or(&[]);
        self.pos = self.bytes.len();
        rest
    }

    /// Skips to the next multiple of `to` (a power of two).
    ///
    /// # Errors
    /// [`WireError::Truncated`] if the bytes end before it.
    pub fn align(&mut self, to: usize) -> Result<(), WireError> {
        let over = self.pos & (to.wrapping_sub(1));
        let skip = if over == 0 { 0 } else { to.wrapping_sub(over) };
        self.take(skip).map(|_| ())
    }

    /// The next `N` bytes as an array, without alignment.
    ///
    /// # Errors
    /// [`WireError::Truncated`].
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], WireError> {
        let bytes = self.take(N)?;
        <[u8; N]>::try_from(bytes).map_err(|_| WireError::Truncated {
            needed: N,
            left: bytes.len(),
        })
    }

    /// One byte.
    ///
    /// # Errors
    /// [`WireError::Truncated`].
    pub fn u8(&mut self) -> Result<u8, WireError> {
        self.array::<1>().map(|[byte]| byte)
    }

    /// An aligned 16-bit number.
    ///
    /// # Errors
    /// [`WireError::Truncated`].
    pub fn u16(&mut self) -> Result<u16, WireError> {
        self.align(2)?;
        let bytes = self.array()?;
        Ok(if self.little {
            u16::from_le_bytes(bytes)
        } else {
            u16::from_be_bytes(bytes)
        })
    }

    /// An aligned 32-bit number.
    ///
    /// # Errors
    /// [`WireError::Truncated`].
    pub fn u32(&mut self) -> Result<u32, WireError> {
        self.align(4)?;
        let bytes = self.array()?;
        Ok(if self.little {
            u32::from_le_bytes(bytes)
        } else {
            u32::from_be_bytes(bytes)
        })
    }

    /// An aligned signed 32-bit number.
    ///
    /// # Errors
    /// [`WireError::Truncated`].
    pub fn i32(&mut self) -> Result<i32, WireError> {
        self.u32().map(u32::cast_signed)
    }

    /// A length-prefixed run of bytes.
    ///
    /// # Errors
    /// [`WireError::Truncated`], also for a length that no message can hold.
    pub fn bytes(&mut self) -> Result<&'a [u8], WireError> {
        let len = self.u32()?;
        self.take(usize::try_from(len).unwrap_or(usize::MAX))
    }

    /// A string; its terminating NUL is not part of the result.
    ///
    /// # Errors
    /// [`WireError::Truncated`], [`WireError::BadString`].
    pub fn string(&mut self) -> Result<&'a str, WireError> {
        let bytes = self.bytes()?;
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        if bytes.contains(&0) {
            return Err(WireError::BadString);
        }
        core::str::from_utf8(bytes).map_err(|_| WireError::BadString)
    }
}
