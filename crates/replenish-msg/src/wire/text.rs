//! Strings as fields. A `wstring` is a `u32` number of UTF-16 units, then the units, without NUL:
//! what the Fast CDR 2 of ROS 2 Jazzy and later writes. (Older ones took 4 bytes for a unit.)

use super::{DecodeInPlace, Encode, Item};
use crate::{CdrError, CdrReader, CdrWriter, Endianness};
use core::fmt;

impl Encode for &str {
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.string(self)
    }
}

impl<'a> Item<'a> for &'a str {
    fn take(r: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        r.string(usize::MAX)
    }
}

/// `uint8[]` and its like: as a sequence, but the bytes are where they were.
impl Encode for &[u8] {
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.sequence(self.len())?;
        w.bytes(self)
    }
}

impl<'a> Item<'a> for &'a [u8] {
    fn take(r: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        let len = r.sequence(usize::MAX)?;
        r.bytes(len)
    }
}

impl<const N: usize> Encode for heapless::String<N> {
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.string(self)
    }
}

impl<const N: usize> DecodeInPlace for heapless::String<N> {
    fn decode_in_place(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        let text = r.string(N)?;
        self.clear();
        self.push_str(text).map_err(|_| CdrError::TooLong {
            len: text.len(),
            limit: N,
        })
    }
}

impl<'a, const N: usize> Item<'a> for heapless::String<N> {
    fn take(r: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        let mut text = Self::new();
        text.decode_in_place(r)?;
        Ok(text)
    }
}

/// UTF-16 units that `text` takes: the length of a `wstring`.
#[must_use]
pub fn wide_len(text: &str) -> usize {
    text.chars().map(char::len_utf16).sum()
}

/// A borrowed `wstring`: UTF-16 as it came, or text that is to be written as UTF-16.
#[derive(Clone, Copy)]
pub struct WStr<'a>(Source<'a>);

#[derive(Clone, Copy)]
enum Source<'a> {
    Text(&'a str),
    Units(&'a [[u8; 2]], Endianness),
}

impl<'a> WStr<'a> {
    /// The characters.
    pub fn chars(&self) -> impl Iterator<Item = char> + use<'a> {
        let (text, units, order) = match self.0 {
            Source::Text(text) => (text, [].as_slice(), Endianness::Little),
            Source::Units(units, order) => ("", units, order),
        };
        let units = units.iter().map(move |unit| match order {
            Endianness::Little => u16::from_le_bytes(*unit),
            Endianness::Big => u16::from_be_bytes(*unit),
        });
        // `take` has checked the units.
        let decoded = char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER));
        text.chars().chain(decoded)
    }

    /// UTF-16 units.
    #[must_use]
    pub fn wide_len(&self) -> usize {
        match self.0 {
            Source::Text(text) => wide_len(text),
            Source::Units(units, _) => units.len(),
        }
    }

    /// Whether there is no character.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.wide_len() == 0
    }
}

impl Default for WStr<'_> {
    fn default() -> Self {
        Self(Source::Text(""))
    }
}

impl<'a> From<&'a str> for WStr<'a> {
    fn from(text: &'a str) -> Self {
        Self(Source::Text(text))
    }
}

impl PartialEq for WStr<'_> {
    fn eq(&self, other: &Self) -> bool {
        self.chars().eq(other.chars())
    }
}

impl Eq for WStr<'_> {}

impl fmt::Display for WStr<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use fmt::Write;
        self.chars().try_for_each(|c| f.write_char(c))
    }
}

impl fmt::Debug for WStr<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\"{self}\"")
    }
}

impl Encode for WStr<'_> {
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.sequence(self.wide_len())?;
        let mut unit = [0; 2];
        self.chars().try_for_each(|c| {
            let units = c.encode_utf16(&mut unit);
            units.iter().try_for_each(|unit| w.u16(*unit))
        })
    }
}

impl<'a> Item<'a> for WStr<'a> {
    fn take(r: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        let len = r.sequence(usize::MAX)?;
        let at = r.position();
        let units = r.primitives(2, len)?.as_chunks().0;
        let order = r.order();
        let checked = char::decode_utf16(units.iter().map(|unit| match order {
            Endianness::Little => u16::from_le_bytes(*unit),
            Endianness::Big => u16::from_be_bytes(*unit),
        }));
        if checked.into_iter().all(|c| c.is_ok()) {
            Ok(Self(Source::Units(units, order)))
        } else {
            Err(CdrError::NotUtf16 { at })
        }
    }
}

/// A `wstring` as UTF-8, inline: `BYTES` is three for each unit of its bound.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct WideString<const BYTES: usize>(pub heapless::String<BYTES>);

impl<const BYTES: usize> WideString<BYTES> {
    /// UTF-16 units.
    #[must_use]
    pub fn wide_len(&self) -> usize {
        wide_len(&self.0)
    }
}

impl<const BYTES: usize> core::ops::Deref for WideString<BYTES> {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0
    }
}

impl<const BYTES: usize> TryFrom<&str> for WideString<BYTES> {
    type Error = CdrError;

    /// # Errors
    /// [`CdrError::TooLong`] above `BYTES` bytes.
    fn try_from(text: &str) -> Result<Self, CdrError> {
        let (len, limit) = (text.len(), BYTES);
        let text = heapless::String::try_from(text);
        text.map(Self).map_err(|_| CdrError::TooLong { len, limit })
    }
}

impl<const BYTES: usize> Encode for WideString<BYTES> {
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        WStr::from(&**self).put(w)
    }
}

impl<const BYTES: usize> DecodeInPlace for WideString<BYTES> {
    fn decode_in_place(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        let text = WStr::take(r)?;
        self.0.clear();
        for c in text.chars() {
            self.0.push(c).map_err(|_| CdrError::TooLong {
                len: text.wide_len(),
                limit: BYTES / 3,
            })?;
        }
        Ok(())
    }
}

impl<'a, const BYTES: usize> Item<'a> for WideString<BYTES> {
    fn take(r: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        let mut text = Self::default();
        text.decode_in_place(r)?;
        Ok(text)
    }
}

#[cfg(feature = "alloc")]
mod owned {
    use super::{CdrError, CdrReader, CdrWriter, DecodeInPlace, Encode, Item, WStr, fmt};
    use alloc::string::String;

    impl Encode for String {
        fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
            w.string(self)
        }
    }

    impl DecodeInPlace for String {
        fn decode_in_place(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
            let text = r.string(usize::MAX)?;
            self.clear();
            self.push_str(text);
            Ok(())
        }
    }

    /// An owned `wstring`: text that is UTF-16 on the wire.
    #[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub struct WString(pub String);

    impl WString {
        /// UTF-16 units.
        #[must_use]
        pub fn wide_len(&self) -> usize {
            super::wide_len(&self.0)
        }
    }

    impl core::ops::Deref for WString {
        type Target = str;

        fn deref(&self) -> &str {
            &self.0
        }
    }

    impl From<&str> for WString {
        fn from(text: &str) -> Self {
            Self(text.into())
        }
    }

    impl From<WStr<'_>> for WString {
        fn from(text: WStr<'_>) -> Self {
            Self(text.chars().collect())
        }
    }

    impl fmt::Display for WString {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(&self.0)
        }
    }

    impl Encode for WString {
        fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
            WStr::from(self.0.as_str()).put(w)
        }
    }

    impl DecodeInPlace for WString {
        fn decode_in_place(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
            let text = WStr::take(r)?;
            self.0.clear();
            self.0.extend(text.chars());
            Ok(())
        }
    }
}

#[cfg(feature = "alloc")]
pub use owned::WString;
