//! [`Reader`]: a bounds-checked cursor over received CDR.

use super::{WireError, padding};

/// Reads CDR from a slice; alignment counts from the slice's start.
#[derive(Clone, Debug)]
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
        self.take(padding(self.pos, to)).map(|_| ())
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

    /// A boolean; every byte but 0 is true.
    ///
    /// # Errors
    /// [`WireError::Truncated`].
    pub fn bool(&mut self) -> Result<bool, WireError> {
        self.u8().map(|byte| byte != 0)
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

    /// An aligned signed 16-bit number.
    ///
    /// # Errors
    /// [`WireError::Truncated`].
    pub fn i16(&mut self) -> Result<i16, WireError> {
        self.u16().map(u16::cast_signed)
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

    /// Steps over the length that the specification puts before an appendable structure of `size`
    /// bytes (XCDR2's DHEADER) and eProsima's implementations leave out, if it is there: it is told
    /// from the structure's own beginning by the bytes that follow.
    ///
    /// # Errors
    /// [`WireError::Truncated`].
    pub(super) fn skip_length(&mut self, size: u16) -> Result<(), WireError> {
        let mut ahead = self.clone();
        if ahead.u32()? == u32::from(size) && ahead.rest().len() >= usize::from(size) {
            self.u32()?;
        }
        Ok(())
    }

    /// A boolean and, if it is true, what `read` reads.
    ///
    /// # Errors
    /// [`WireError::Truncated`] and those of `read`.
    pub fn option<T>(
        &mut self,
        read: impl FnOnce(&mut Self) -> Result<T, WireError>,
    ) -> Result<Option<T>, WireError> {
        if self.bool()? {
            read(self).map(Some)
        } else {
            Ok(None)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn big_endian_is_read_and_absurd_lengths_are_refused() {
        let mut r = Reader::new(&[0, 1, 0, 0, 0, 0, 0, 2, 0xff, 0xff, 0xff, 0xff], false);
        assert_eq!((r.u16(), r.u32()), (Ok(1), Ok(2)));
        assert_eq!(
            r.bytes(),
            Err(WireError::Truncated {
                needed: u32::MAX as usize,
                left: 0
            })
        );
        assert_eq!(
            Reader::new(&[3, 0, 0, 0, b'a', 0, b'b'], true).string(),
            Err(WireError::BadString)
        );
        assert_eq!(
            Reader::new(&[1, 0, 0, 0, 0xff], true).string(),
            Err(WireError::BadString)
        );
        assert_eq!(Reader::new(&[0, 0, 0, 0], true).string(), Ok(""));
    }
}
