//! The traits of a message's field: [`Encode`] is written, [`DecodeInPlace`] is read in place,
//! [`Item`] is read anew and may borrow from the bytes. Generated code calls these, field by field.
//!
//! | field | owned (feature `alloc`) | borrowed |
//! |---|---|---|
//! | primitive, message | itself | itself, or its [view](crate::View) |
//! | `string` | `String` | `&str` |
//! | `wstring` | [`WString`] | [`WStr`] |
//! | `string<=N`, `T[<=N]` of a bounded type | `heapless` | the same, or as unbounded if large |
//! | `wstring<=N` | [`WideString`] | the same, or as unbounded if large |
//! | `uint8[]`, `byte[]`, `char[]` | `Vec<u8>` | `&[u8]` |
//! | `T[]` | `Vec` | [`Seq`] |
//! | `T[N]` | array | array |

mod collections;
mod primitives;
mod seq;
mod text;

pub use seq::{Iter, Seq};
#[cfg(feature = "alloc")]
pub use text::WString;
pub use text::{WStr, WideString, wide_len};

use crate::{CdrError, CdrReader, CdrWriter, Message};

/// A value that can be written.
pub trait Encode {
    /// Bytes of one on the wire if any such bytes are a value (a primitive, but not `bool`); else
    /// 0.
    const PRIMITIVE: usize = 0;

    /// Appends this value.
    ///
    /// # Errors
    /// [`CdrError::EndOfBuffer`]; [`CdrError::TooLong`] above `u32::MAX` elements.
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError>;

    /// Appends several in a row, without their number.
    ///
    /// # Errors
    /// As [`put`](Self::put).
    fn put_all(items: &[Self], w: &mut CdrWriter<'_>) -> Result<(), CdrError>
    where
        Self: Sized,
    {
        items.iter().try_for_each(|item| item.put(w))
    }
}

/// A value that can be read in place, without a new one.
pub trait DecodeInPlace: Encode {
    /// Replaces this value by the next in `r`.
    ///
    /// # Errors
    /// Any [`CdrError`]; the value is then valid but unspecified.
    fn decode_in_place(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError>;

    /// Replaces several in a row.
    ///
    /// # Errors
    /// As [`decode_in_place`](Self::decode_in_place).
    fn decode_all_in_place(items: &mut [Self], r: &mut CdrReader<'_>) -> Result<(), CdrError>
    where
        Self: Sized,
    {
        items
            .iter_mut()
            .try_for_each(|item| item.decode_in_place(r))
    }
}

/// A value that can be read anew without allocation.
pub trait Item<'a>: Encode + Sized {
    /// Reads the next value in `r`.
    ///
    /// # Errors
    /// Any [`CdrError`].
    fn take(r: &mut CdrReader<'a>) -> Result<Self, CdrError>;

    /// Passes over `count` values and checks them.
    ///
    /// # Errors
    /// As [`take`](Self::take).
    fn pass(count: usize, r: &mut CdrReader<'a>) -> Result<(), CdrError> {
        (0..count).try_for_each(|_| Self::take(r).map(|_| ()))
    }
}

impl<M: Message> Encode for M {
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        self.encode(w)
    }
}

impl<M: Message> DecodeInPlace for M {
    fn decode_in_place(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.decode(r)
    }
}

/// Meant for bounded messages; others allocate here, and have a [view](crate::View) instead.
impl<'a, M: Message> Item<'a> for M {
    fn take(r: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        let mut message = M::default();
        message.decode(r)?;
        Ok(message)
    }
}

/// Checks a length that is to be written against the bound of its field.
///
/// # Errors
/// [`CdrError::TooLong`].
pub fn at_most(len: usize, limit: usize) -> Result<(), CdrError> {
    if len <= limit {
        Ok(())
    } else {
        Err(CdrError::TooLong { len, limit })
    }
}

/// Checks the length of the sequence or wide string that comes next, without taking it.
///
/// # Errors
/// [`CdrError::EndOfBuffer`], [`CdrError::TooLong`].
pub fn next_at_most(r: &CdrReader<'_>, limit: usize) -> Result<(), CdrError> {
    r.clone().sequence(limit).map(|_| ())
}

/// Checks the length in bytes of the string that comes next, without taking it.
///
/// # Errors
/// [`CdrError::EndOfBuffer`], [`CdrError::TooLong`].
pub fn next_text_at_most(r: &CdrReader<'_>, limit: usize) -> Result<(), CdrError> {
    let with_nul = r.clone().sequence(usize::MAX)?;
    at_most(with_nul.saturating_sub(1), limit)
}
