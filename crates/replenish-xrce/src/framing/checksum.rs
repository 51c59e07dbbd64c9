//! The checksum of serial frames: CRC-16/ARC, polynomial x^16 + x^15 + x^2 + 1, from 0, lowest bit
//! first.
//!
//! The polynomial is (x + 1)(x^15 + x + 1). Modulo x + 1 a message is its parity, so that all its
//! words are added up first; modulo x^15 + x + 1 sparse powers do for whole words what a table does
//! for bytes:
//!
//! ```text
//!   x^15 = x + 1          what is above x^14 comes back as itself 15 lower, and once more 14 lower
//!   x^32 = x^4 + x^2      the remainder is brought behind a word of four bytes
//!   x^16 = x^2 + x        and, at the end, behind the checksum
//! ```
//!
//! Of the two remainders below x^15 + x + 1 and above, the one with the message's parity is the
//! checksum. Words have their highest power at bit 0, as the line has it first: multiplying is
//! shifting right.

/// The polynomial's factor x^15 + x + 1, as a checksum has its bits.
const FACTOR: u16 = 0xc001;

/// The powers below x^15 of a word.
const BELOW: u32 = 0xfffe_0000;

/// The checksum of a message so far.
#[derive(Clone, Copy)]
struct Sum {
    /// The remainder modulo x^15 + x + 1, up to x^17.
    rest: u32,
    /// All words, added up.
    all: u32,
}

impl Sum {
    const fn word(&mut self, word: u32) {
        self.all ^= word;
        self.rest = folded(word ^ (self.rest >> 2) ^ (self.rest >> 4));
    }

    const fn byte(&mut self, byte: u8) {
        let word = u32::from_le_bytes([0, 0, 0, byte]);
        self.all ^= word;
        self.rest = folded(word ^ (self.rest >> 8));
    }

    const fn end(self) -> u16 {
        let [_, _, low, high] = folded((self.rest >> 1) ^ (self.rest >> 2)).to_le_bytes();
        let below = u16::from_le_bytes([low, high]);
        match (self.all ^ below as u32).count_ones() & 1 {
            0 => below,
            _ => below ^ FACTOR,
        }
    }
}

/// The same modulo x^15 + x + 1, at most x^17.
const fn folded(word: u32) -> u32 {
    let above = word << 15;
    (word & BELOW) ^ above ^ (above >> 1)
}

/// A message's checksum, and 0 if none of its bytes is 0x7D to 0x7F.
#[inline(never)]
pub(super) fn checked(message: &[u8]) -> (u16, u32) {
    let (words, end) = message.as_chunks();
    let (mut sum, mut special) = (Sum { rest: 0, all: 0 }, 0);
    for &word in words {
        let word = u32::from_le_bytes(word);
        special |= special_in(word);
        sum.word(word);
    }
    for &byte in end {
        special |= special_in(byte.into());
        sum.byte(byte);
    }
    (sum.end(), special & SPECIAL)
}

/// A message's checksum.
pub(super) fn checksum(message: &[u8]) -> u16 {
    checked(message).0
}

/// The bits in which [`special_in`] reports its result.
pub(super) const SPECIAL: u32 = 0x8080_8080;

/// Tests four bytes at once: the bits of [`SPECIAL`] show whether any is 0x7D to 0x7F. Adding 3
/// sets the highest bit of a byte of at least 0x7D; the last term leaves bytes of 0x80 and above
/// out.
#[inline(always)]
pub(super) const fn special_in(bytes: u32) -> u32 {
    (bytes & !SPECIAL).wrapping_add(0x0303_0303) & !bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// The checksum as the catalogue defines it, bit by bit.
    fn slow(message: &[u8]) -> u16 {
        message.iter().fold(0, |crc, byte| {
            (0..8).fold(crc ^ u16::from(*byte), |crc, _| {
                (crc >> 1) ^ (0xa001 & 0_u16.wrapping_sub(crc & 1))
            })
        })
    }

    #[test]
    fn the_checksum_is_the_one_of_the_catalogue() {
        assert_eq!(checksum(b"123456789"), 0xbb3d);
        assert_eq!(checksum(&[]), 0);
    }

    /// The checksum is linear: all messages of one bit, of every length, and all short ones stand
    /// for the rest.
    #[test]
    fn words_and_bytes_are_bits_one_after_another() {
        for len in 0..=23 {
            for bit in 0..8 * len {
                let mut message = std::vec![0; len];
                message[bit / 8] = 1 << (bit % 8);
                assert_eq!(
                    checksum(&message),
                    slow(&message),
                    "bit {bit} of {len} bytes"
                );
            }
        }
        for both in 0..=u16::MAX {
            let message = both.to_le_bytes();
            assert_eq!(checksum(&message), slow(&message));
        }
        let mut seed = 1_u32;
        let long: Vec<u8> = (0..500)
            .map(|_| {
                seed = seed.wrapping_mul(1_103_515_245).wrapping_add(12_345);
                seed.to_le_bytes()[2]
            })
            .collect();
        for len in 0..long.len() {
            assert_eq!(checksum(&long[..len]), slow(&long[..len]));
        }
    }

    #[test]
    fn special_bytes_are_seen_in_every_place() {
        for byte in 0..=u8::MAX {
            for at in 0..7 {
                let mut message = [0x7c, 0x80, 0, 0xff, 0x3c, 0xfc, 0x5e];
                message[at] = byte;
                let seen = checked(&message).1 != 0;
                assert_eq!(seen, matches!(byte, 0x7d..=0x7f), "{byte:#x} at {at}");
            }
        }
    }
}
