//! Sequence numbers of streams: 16 bits that wrap, compared as serial numbers (RFC 1982).

/// A message's sequence number in its stream. The first one is 0; after 65535 comes 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SeqNum(pub u16);

impl SeqNum {
    /// The number `by` messages later.
    #[must_use]
    pub const fn plus(self, by: u16) -> SeqNum {
        SeqNum(self.0.wrapping_add(by))
    }

    /// The number `count` messages later: it wraps, however many there are.
    #[must_use]
    pub(crate) const fn ahead(self, count: usize) -> SeqNum {
        self.plus((count & 0xffff) as u16)
    }

    /// The number one message earlier.
    #[must_use]
    pub const fn previous(self) -> SeqNum {
        SeqNum(self.0.wrapping_sub(1))
    }

    /// Distance of `self` from `earlier`: positive if later, negative if earlier, taking the
    /// shorter way round. Exactly half-way round counts as earlier.
    #[must_use]
    pub const fn since(self, earlier: SeqNum) -> i16 {
        self.0.wrapping_sub(earlier.0).cast_signed()
    }

    /// Whether `self` comes after `other`.
    #[must_use]
    pub const fn is_after(self, other: SeqNum) -> bool {
        self.since(other) > 0
    }
}

#[cfg(test)]
mod tests {
    use super::SeqNum;

    #[test]
    fn wraps_and_compares_across_the_wrap() {
        assert_eq!(SeqNum(65535).plus(1), SeqNum(0));
        assert_eq!(SeqNum(0).previous(), SeqNum(65535));
        assert!(SeqNum(2).is_after(SeqNum(65530)));
        assert!(!SeqNum(65530).is_after(SeqNum(2)));
        assert_eq!(SeqNum(2).since(SeqNum(65534)), 4);
        assert_eq!(SeqNum(7).since(SeqNum(7)), 0);
        assert!(!SeqNum(0x8000).is_after(SeqNum(0)));
    }
}
