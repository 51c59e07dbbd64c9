//! [`Reader`]: a bounds-checked cursor over received CDR.

use crate::padding;
use core::marker::PhantomData;

/// The error of a protocol, made from the two things that a [`Reader`] can find.
pub trait ReadError: Sized {
    /// The next field needs `needed` bytes, and `left` are left.
    fn truncated(needed: usize, left: usize) -> Self;
    /// A string is not UTF-8, or has a NUL inside.
    fn bad_string() -> Self;
}

/// Reads CDR from a slice; alignment counts from the slice's start.
#[derive(Clone, Copy, Debug)]
pub struct Reader<'a, E> {
    bytes: &'a [u8],
    pos: usize,
    little: bool,
    error: PhantomData<E>,
}

impl<'a, E: ReadError> Reader<'a, E> {
    /// A reader at the start of `bytes`.
    #[must_use]
    pub const fn new(bytes: &'a [u8], little_endian: bool) -> Self {
        Reader {
            bytes,
            pos: 0,
            little: little_endian,
            error: PhantomData,
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
    /// [`ReadError::truncated`] if fewer are left.
    pub fn take(&mut self, n: usize) -> Result<&'a [u8], E> {
        let rest = self.bytes.get(self.pos..).unwrap_or(&[]);
        let Some((head, _)) = rest.split_at_checked(n) else {
            return Err(E::truncated(n, rest.len()));
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
    /// [`ReadError::truncated`] if the bytes end before it.
    pub fn align(&mut self, to: usize) -> Result<(), E> {
        self.take(padding(self.pos, to)).map(|_| ())
    }

    /// The next `N` bytes as an array, without alignment.
    ///
    /// # Errors
    /// [`ReadError::truncated`].
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], E> {
        let bytes = self.take(N)?;
        <[u8; N]>::try_from(bytes).map_err(|_| E::truncated(N, bytes.len()))
    }

    /// One byte.
    ///
    /// # Errors
    /// [`ReadError::truncated`].
    pub fn u8(&mut self) -> Result<u8, E> {
        self.array::<1>().map(|[byte]| byte)
    }

    /// A boolean; every byte but 0 is true.
    ///
    /// # Errors
    /// [`ReadError::truncated`].
    pub fn bool(&mut self) -> Result<bool, E> {
        self.u8().map(|byte| byte != 0)
    }

    /// An aligned 16-bit number.
    ///
    /// # Errors
    /// [`ReadError::truncated`].
    pub fn u16(&mut self) -> Result<u16, E> {
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
    /// [`ReadError::truncated`].
    pub fn i16(&mut self) -> Result<i16, E> {
        self.u16().map(u16::cast_signed)
    }

    /// An aligned 32-bit number.
    ///
    /// # Errors
    /// [`ReadError::truncated`].
    pub fn u32(&mut self) -> Result<u32, E> {
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
    /// [`ReadError::truncated`].
    pub fn i32(&mut self) -> Result<i32, E> {
        self.u32().map(u32::cast_signed)
    }

    /// A length-prefixed run of bytes.
    ///
    /// # Errors
    /// [`ReadError::truncated`], also for a length that no message can hold.
    pub fn bytes(&mut self) -> Result<&'a [u8], E> {
        let len = self.u32()?;
        self.take(usize::try_from(len).unwrap_or(usize::MAX))
    }

    /// A string; its terminating NUL is not part of the result.
    ///
    /// # Errors
    /// [`ReadError::truncated`], [`ReadError::bad_string`].
    pub fn string(&mut self) -> Result<&'a str, E> {
        let bytes = self.bytes()?;
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        if bytes.contains(&0) {
            return Err(E::bad_string());
        }
        core::str::from_utf8(bytes).map_err(|_| E::bad_string())
    }

    /// A boolean and, if it is true, what `read` reads.
    ///
    /// # Errors
    /// [`ReadError::truncated`] and those of `read`.
    pub fn option<T>(
        &mut self,
        read: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<Option<T>, E> {
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

    #[derive(Debug, PartialEq)]
    enum Found {
        Truncated { needed: usize, left: usize },
        BadString,
    }

    impl ReadError for Found {
        fn truncated(needed: usize, left: usize) -> Self {
            Self::Truncated { needed, left }
        }
        fn bad_string() -> Self {
            Self::BadString
        }
    }

    type Reader<'a> = super::Reader<'a, Found>;

    #[test]
    fn big_endian_is_read_and_absurd_lengths_are_refused() {
        let mut r = Reader::new(&[0, 1, 0, 0, 0, 0, 0, 2, 0xff, 0xff, 0xff, 0xff], false);
        assert_eq!((r.u16(), r.u32()), (Ok(1), Ok(2)));
        assert_eq!(
            r.bytes(),
            Err(Found::Truncated {
                needed: u32::MAX as usize,
                left: 0
            })
        );
        assert_eq!(
            Reader::new(&[3, 0, 0, 0, b'a', 0, b'b'], true).string(),
            Err(Found::BadString)
        );
        assert_eq!(
            Reader::new(&[1, 0, 0, 0, 0xff], true).string(),
            Err(Found::BadString)
        );
        assert_eq!(Reader::new(&[0, 0, 0, 0], true).string(), Ok(""));
    }
}
