//! Sequence numbers, and sets of numbers as ACKNACK, GAP and `NACK_FRAG` carry them
//! (RTPS 2.5, 9.4.2.5 and 9.4.2.6).

use super::{Reader, WireError, Writer};

/// The number of a writer's sample: 1 is the first.
pub type SequenceNumber = i64;

/// The greatest sequence number that is taken from a peer: additions cannot overflow behind it.
pub const MAX_SEQUENCE_NUMBER: SequenceNumber = i64::MAX / 4;

pub(super) fn sequence_number(r: &mut Reader<'_>) -> Result<SequenceNumber, WireError> {
    let high = i64::from(r.i32()?);
    let low = i64::from(r.u32()?);
    Ok((high << 32) | low)
}

/// A sequence number from `least` on.
pub(super) fn bounded(
    r: &mut Reader<'_>,
    least: SequenceNumber,
    field: &'static str,
) -> Result<SequenceNumber, WireError> {
    match sequence_number(r)? {
        sn if (least..=MAX_SEQUENCE_NUMBER).contains(&sn) => Ok(sn),
        _ => Err(WireError::OutOfRange(field)),
    }
}

pub(super) fn put_sequence_number(w: &mut Writer<'_>, sn: SequenceNumber) {
    w.i32(i32::try_from(sn >> 32).unwrap_or(i32::MAX));
    w.u32((sn & 0xffff_ffff).unsigned_abs() as u32);
}

/// Up to 256 bits, the first one being number 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bits {
    len: u32,
    words: [u32; 8],
}

impl Bits {
    /// The most bits there can be.
    pub const MAX: u32 = 256;

    /// No bits.
    pub const EMPTY: Bits = Bits {
        len: 0,
        words: [0; 8],
    };

    /// Bits in the set, whether set or not.
    #[must_use]
    pub const fn len(&self) -> u32 {
        self.len
    }

    /// Whether no bit is set.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.iter().next().is_none()
    }

    /// Sets bit `at` and makes the set long enough for it; `false` from bit 256 on.
    pub fn set(&mut self, at: u32) -> bool {
        let Some(word) = self.words.get_mut((at / 32) as usize) else {
            return false;
        };
        *word |= 1 << (31 - at % 32);
        self.len = self.len.max(at + 1);
        true
    }

    /// Clears bit `at`.
    pub fn clear(&mut self, at: u32) {
        if let Some(word) = self.words.get_mut((at / 32) as usize) {
            *word &= !(1 << (31 - at % 32));
        }
    }

    /// Whether bit `at` is set.
    #[must_use]
    pub fn contains(&self, at: u32) -> bool {
        let word = self.words.get((at / 32) as usize);
        at < self.len && word.is_some_and(|word| word & (1 << (31 - at % 32)) != 0)
    }

    /// Bits that are set.
    #[must_use]
    pub fn count(&self) -> u16 {
        self.words.iter().map(|word| word.count_ones() as u16).sum()
    }

    /// The numbers of set bits, ascending.
    pub fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.len).filter(|at| self.contains(*at))
    }

    fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        let len = r.u32()?;
        if len > Self::MAX {
            return Err(WireError::OutOfRange("numBits (at most 256)"));
        }
        let mut bits = Bits { len, ..Self::EMPTY };
        for word in bits.words.iter_mut().take(len.div_ceil(32) as usize) {
            *word = r.u32()?;
        }
        Ok(bits)
    }

    fn encode(&self, w: &mut Writer<'_>) {
        w.u32(self.len);
        for word in self.words.iter().take(self.len.div_ceil(32) as usize) {
            w.u32(*word);
        }
    }
}

/// Sequence numbers from `base` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SequenceSet {
    /// The number of bit 0. In an ACKNACK: everything below has arrived.
    pub base: SequenceNumber,
    /// The numbers of the set, counted from the base.
    pub bits: Bits,
}

impl SequenceSet {
    /// An empty set.
    #[must_use]
    pub const fn empty(base: SequenceNumber) -> Self {
        SequenceSet {
            base,
            bits: Bits::EMPTY,
        }
    }

    /// Adds `sn`; `false` if it is below the base or 256 or more above.
    pub fn insert(&mut self, sn: SequenceNumber) -> bool {
        let at = sn.checked_sub(self.base).map(u32::try_from);
        matches!(at, Some(Ok(at)) if self.bits.set(at))
    }

    /// The numbers, ascending.
    pub fn iter(&self) -> impl Iterator<Item = SequenceNumber> + '_ {
        let numbers = self.bits.iter();
        numbers.map(|at| self.base.saturating_add(i64::from(at)))
    }

    /// Fast DDS sends base 0 before it has heard of any sample.
    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        Ok(SequenceSet {
            base: bounded(r, 0, "bitmapBase")?,
            bits: Bits::decode(r)?,
        })
    }

    pub(super) fn encode(&self, w: &mut Writer<'_>) {
        put_sequence_number(w, self.base);
        self.bits.encode(w);
    }
}

/// Numbers of fragments from `base` on; 1 is the first fragment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FragmentSet {
    /// The number of bit 0.
    pub base: u32,
    /// The numbers of the set, counted from the base.
    pub bits: Bits,
}

impl FragmentSet {
    /// An empty set.
    #[must_use]
    pub const fn empty(base: u32) -> Self {
        FragmentSet {
            base,
            bits: Bits::EMPTY,
        }
    }

    /// Adds `number`; `false` if it is below the base or 256 or more above.
    pub fn insert(&mut self, number: u32) -> bool {
        let at = number.checked_sub(self.base);
        at.is_some_and(|at| self.bits.set(at))
    }

    /// The numbers, ascending.
    pub fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        self.bits.iter().map(|at| self.base.saturating_add(at))
    }

    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        let base = r.u32()?;
        if base == 0 {
            return Err(WireError::OutOfRange("fragmentNumberState (from 1)"));
        }
        Ok(FragmentSet {
            base,
            bits: Bits::decode(r)?,
        })
    }

    pub(super) fn encode(&self, w: &mut Writer<'_>) {
        w.u32(self.base);
        self.bits.encode(w);
    }
}
