//! The set of readers that the dispatcher wants to hear about.

use super::ReaderId;
use crate::platform::STD;

/// The most readers one middleware can have: 1024, and 64 without the standard library.
pub const MAX_READERS: usize = if STD { 1024 } else { 64 };

/// Bits of a word: what the processor has.
const BITS: usize = usize::BITS as usize;
const WORDS: usize = MAX_READERS / BITS;

/// A set of readers: those whose handle has room for a sample. A bit each, no allocation.
///
/// ```
/// use replenish::middleware::{Interest, ReaderId};
/// let mut set = Interest::empty();
/// set.insert(ReaderId(3));
/// assert!(set.contains(ReaderId(3)) && !set.contains(ReaderId(4)));
/// assert_eq!(set.iter().collect::<Vec<_>>(), [ReaderId(3)]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Interest {
    words: [usize; WORDS],
    /// The number of members: each message asks whether there are any.
    members: usize,
}

impl Interest {
    /// No reader.
    #[must_use]
    pub const fn empty() -> Self {
        Self {
            words: [0; WORDS],
            members: 0,
        }
    }

    /// Adds a reader. Ids of [`MAX_READERS`] and above are never members.
    pub fn insert(&mut self, reader: ReaderId) {
        let (word, bit) = place(reader);
        if let Some(w) = self.words.get_mut(word) {
            self.members += usize::from(*w & bit == 0);
            *w |= bit;
        }
    }

    /// Removes a reader.
    pub fn remove(&mut self, reader: ReaderId) {
        let (word, bit) = place(reader);
        if let Some(w) = self.words.get_mut(word) {
            self.members -= usize::from(*w & bit != 0);
            *w &= !bit;
        }
    }

    /// Whether the reader is a member.
    #[must_use]
    pub fn contains(&self, reader: ReaderId) -> bool {
        let (word, bit) = place(reader);
        self.words.get(word).is_some_and(|w| w & bit != 0)
    }

    /// Whether there is no member.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.members == 0
    }

    /// The number of members.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.members
    }

    /// The members in ascending order.
    pub fn iter(&self) -> impl Iterator<Item = ReaderId> + '_ {
        Members {
            set: self,
            word: 0,
            rest: self.words.first().copied().unwrap_or(0),
        }
    }

    /// Whether a reader is a member of both.
    #[cfg(feature = "xrce")]
    pub(crate) fn meets(&self, other: &Self) -> bool {
        let mut words = self.words.iter().zip(&other.words);
        words.any(|(a, b)| a & b != 0)
    }
}

/// The members of a set that were not given out yet.
struct Members<'a> {
    set: &'a Interest,
    word: usize,
    /// Members of `word` that are left.
    rest: usize,
}

impl Iterator for Members<'_> {
    type Item = ReaderId;

    fn next(&mut self) -> Option<ReaderId> {
        while self.rest == 0 {
            self.word += 1;
            self.rest = *self.set.words.get(self.word)?;
        }
        let bit = self.word * BITS + self.rest.trailing_zeros() as usize;
        self.rest &= self.rest - 1;
        u16::try_from(bit).ok().map(ReaderId)
    }
}

fn place(reader: ReaderId) -> (usize, usize) {
    let number = usize::from(reader.0);
    (number / BITS, 1 << (number % BITS))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holds_what_was_inserted_across_words() {
        let mut set = Interest::empty();
        for id in [0, 63, 64, 1023] {
            set.insert(ReaderId(id));
        }
        set.remove(ReaderId(63));
        set.remove(ReaderId(100));
        assert_eq!(set.iter().map(|r| r.0).collect::<Vec<_>>(), [0, 64, 1023]);
        assert_eq!(set.len(), 3);
    }

    #[test]
    fn ids_beyond_the_capacity_are_never_members() {
        let mut set = Interest::empty();
        set.insert(ReaderId(1024));
        set.insert(ReaderId(u16::MAX));
        assert!(set.is_empty());
    }
}
