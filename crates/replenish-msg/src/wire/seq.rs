//! A borrowed sequence: elements as they came, decoded when one looks at them.

use super::{Encode, Item};
use crate::{CdrError, CdrReader, CdrWriter};
use core::fmt;

/// A sequence in the bytes of a message, or a slice that is to be written as one.
///
/// The bytes were checked when the sequence was taken, so looking at an element cannot fail.
pub struct Seq<'a, T>(Source<'a, T>);

enum Source<'a, T> {
    Slice(&'a [T]),
    /// At the first element, with their number.
    Bytes(CdrReader<'a>, usize),
}

impl<T> Clone for Seq<'_, T> {
    fn clone(&self) -> Self {
        Self(match &self.0 {
            Source::Slice(items) => Source::Slice(items),
            Source::Bytes(reader, len) => Source::Bytes(reader.clone(), *len),
        })
    }
}

impl<T> Default for Seq<'_, T> {
    fn default() -> Self {
        Self(Source::Slice(&[]))
    }
}

impl<'a, T> From<&'a [T]> for Seq<'a, T> {
    fn from(items: &'a [T]) -> Self {
        Self(Source::Slice(items))
    }
}

impl<'a, T, const N: usize> From<&'a [T; N]> for Seq<'a, T> {
    fn from(items: &'a [T; N]) -> Self {
        Self(Source::Slice(items))
    }
}

impl<T> Seq<'_, T> {
    /// The number of elements.
    #[must_use]
    pub fn len(&self) -> usize {
        match &self.0 {
            Source::Slice(items) => items.len(),
            Source::Bytes(_, len) => *len,
        }
    }

    /// Whether there is no element.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl<'a, T: Item<'a> + Clone> Seq<'a, T> {
    /// The elements, decoded one by one.
    #[must_use]
    pub fn iter(&self) -> Iter<'a, T> {
        Iter(self.clone())
    }

    /// The element at `index`, if there is one. Takes constant time for primitives but `bool`, and
    /// for others as long as decoding all before it.
    #[must_use]
    pub fn get(&self, index: usize) -> Option<T> {
        match &self.0 {
            Source::Slice(items) => items.get(index).cloned(),
            Source::Bytes(_, len) if index >= *len => None,
            Source::Bytes(reader, _) => {
                let mut reader = reader.clone();
                T::pass(index, &mut reader).ok()?;
                T::take(&mut reader).ok()
            }
        }
    }
}

/// The elements of a [`Seq`].
#[derive(Clone)]
pub struct Iter<'a, T>(Seq<'a, T>);

impl<'a, T: Item<'a> + Clone> Iterator for Iter<'a, T> {
    type Item = T;

    fn next(&mut self) -> Option<T> {
        match &mut self.0.0 {
            Source::Slice(items) => {
                let (first, rest) = items.split_first()?;
                *items = rest;
                Some(first.clone())
            }
            Source::Bytes(reader, left) => {
                *left = left.checked_sub(1)?;
                T::take(reader).ok()
            }
        }
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        (self.0.len(), Some(self.0.len()))
    }
}

impl<'a, T: Item<'a> + Clone> ExactSizeIterator for Iter<'a, T> {}

impl<'a, T: Item<'a> + Clone> IntoIterator for Seq<'a, T> {
    type Item = T;
    type IntoIter = Iter<'a, T>;

    fn into_iter(self) -> Iter<'a, T> {
        Iter(self)
    }
}

impl<'a, T: Item<'a> + Clone + PartialEq> PartialEq for Seq<'a, T> {
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other.iter())
    }
}

impl<'a, T: Item<'a> + Clone + fmt::Debug> fmt::Debug for Seq<'a, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl<'a, T: Item<'a>> Encode for Seq<'a, T> {
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.sequence(self.len())?;
        match &self.0 {
            Source::Slice(items) => T::put_all(items, w),
            Source::Bytes(reader, len) => {
                let mut reader = reader.clone();
                (0..*len).try_for_each(|_| T::take(&mut reader)?.put(w))
            }
        }
    }
}

impl<'a, T: Item<'a>> Item<'a> for Seq<'a, T> {
    fn take(r: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        let len = r.sequence(usize::MAX)?;
        let first = r.clone();
        T::pass(len, r)?;
        Ok(Self(Source::Bytes(first, len)))
    }
}
