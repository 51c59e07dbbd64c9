//! Serial lines: frames that begin with a byte that occurs nowhere else, and end with a checksum.
//!
//! ```text
//!              0x7E                 4 bytes              length bytes            2 bytes
//!   HUNTING ──────────► HEADER ──────────────► PAYLOAD ───────────────► CRC ───────────► HUNTING
//!                          ▲                                                   deliver if it fits
//!                          └── 0x7E, from every state: the frame before it is lost, this one is not
//! ```
//!
//! Inside a frame 0x7E and 0x7D are sent as 0x7D and the byte with bit 5 flipped, so that a damaged
//! or cut frame costs itself and what the damage hides, never what begins after it.

use crate::count;
use core::fmt;

const BEGIN: u8 = 0x7e;
const ESCAPE: u8 = 0x7d;
const FLIP: u8 = 0x20;

/// The address agents have on a serial line.
pub const SERIAL_AGENT: u8 = 0;
/// The address clients have on a serial line unless told otherwise.
pub const SERIAL_CLIENT: u8 = 1;

/// The buffer is too short for the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameTooShort;

impl fmt::Display for FrameTooShort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the buffer is too short for the frame")
    }
}

impl core::error::Error for FrameTooShort {}

/// The most bytes that a frame with a message of `len` bytes can have.
#[must_use]
pub const fn serial_frame_len(len: usize) -> usize {
    len.saturating_add(6).saturating_mul(2).saturating_add(1)
}

/// Writes `message` as a frame from `source` to `target` into `out`; gives its length.
///
/// # Errors
/// [`FrameTooShort`] if `out` is, which it is never with [`serial_frame_len`] bytes, or if the
/// message is longer than 65535 bytes.
pub fn serial_frame(
    source: u8,
    target: u8,
    message: &[u8],
    out: &mut [u8],
) -> Result<usize, FrameTooShort> {
    let [low, high] = u16::try_from(message.len())
        .map_err(|_| FrameTooShort)?
        .to_le_bytes();
    let crc = message.iter().fold(0, |crc, byte| crc16(crc, *byte));
    let (whole, mut room) = (out.len(), out.iter_mut());
    let mut put = |byte: u8| {
        *room.next()? = byte;
        Some(())
    };
    let mut frame = || {
        put(BEGIN)?;
        for part in [&[source, target, low, high], message, &crc.to_le_bytes()] {
            for &byte in part {
                let special = matches!(byte, BEGIN | ESCAPE);
                if special {
                    put(ESCAPE)?;
                }
                put(if special { byte ^ FLIP } else { byte })?;
            }
        }
        Some(())
    };
    frame().ok_or(FrameTooShort)?;
    Ok(whole.saturating_sub(room.len()))
}

/// What a [`Serial`] has seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct FrameStats {
    /// Messages handed out.
    pub frames: u64,
    /// Frames with a wrong checksum.
    pub damaged: u64,
    /// Frames that ended before their length said so, because another one began.
    pub cut: u64,
    /// Frames longer than the buffer.
    pub too_long: u64,
    /// Frames for somebody else.
    pub not_mine: u64,
    /// Bytes outside of frames.
    pub noise: u64,
}

/// Bytes of the header behind the one that begins a frame: source, target, length.
const HEADER: usize = 4;

/// [`Serial::at`] outside of frames.
const HUNTING: usize = usize::MAX;

/// Finds messages in the bytes of a line; the longest is as long as `B`.
///
/// The checksum covers the message alone, as in the stock framing: a damaged address is not noticed
/// here, and 1 in 65536 damaged messages passes.
#[derive(Debug)]
pub struct Serial<B> {
    buf: B,
    local: u8,
    /// Bytes of the frame that have come; [`HUNTING`] for none.
    at: usize,
    escaped: bool,
    header: [u8; HEADER],
    /// Of the message so far; with the checksum behind it, 0.
    crc: u16,
    stats: FrameStats,
}

impl<B: AsRef<[u8]> + AsMut<[u8]>> Serial<B> {
    /// A line of which nothing was seen yet, at address `local`.
    pub const fn new(local: u8, buf: B) -> Self {
        Self {
            buf,
            local,
            at: HUNTING,
            escaped: false,
            header: [0; HEADER],
            crc: 0,
            stats: FrameStats {
                frames: 0,
                damaged: 0,
                cut: 0,
                too_long: 0,
                not_mine: 0,
                noise: 0,
            },
        }
    }

    /// What happened so far.
    pub const fn stats(&self) -> FrameStats {
        self.stats
    }

    /// Takes in bytes of the line; calls `deliver` with the sender's address and the message of
    /// each frame that ends in them unharmed.
    pub fn push(&mut self, mut bytes: &[u8], mut deliver: impl FnMut(u8, &[u8])) {
        loop {
            if let Some((source, message, rest)) = self.whole(bytes) {
                self.at = HUNTING;
                count(&mut self.stats.frames);
                deliver(source, message);
                bytes = rest;
                continue;
            }
            bytes = self.plain(bytes);
            let Some((&byte, rest)) = bytes.split_first() else {
                return;
            };
            bytes = rest;
            if byte == BEGIN {
                self.begin();
            } else if self.at == HUNTING {
                count(&mut self.stats.noise);
            } else if byte == ESCAPE {
                self.escaped = true;
            } else {
                let flip = if core::mem::take(&mut self.escaped) {
                    FLIP
                } else {
                    0
                };
                if self.step(byte ^ flip) {
                    let [source, ..] = self.header;
                    let message = self.buf.as_ref().get(..self.announced()).unwrap_or(&[]);
                    deliver(source, message);
                }
            }
        }
    }

    /// The frame that `bytes` begin with, if it is there as a whole, unharmed, and all its bytes stand
    /// for themselves, as in most: its sender, its message where it lies, and what follows it.
    fn whole<'a>(&self, bytes: &'a [u8]) -> Option<(u8, &'a [u8], &'a [u8])> {
        let (&[BEGIN, source, target, low, high], rest) = bytes.split_first_chunk()? else {
            return None;
        };
        let len = usize::from(u16::from_le_bytes([low, high]));
        let (message, rest) = rest.split_at_checked(len)?;
        let (&tail, after) = rest.split_first_chunk()?;
        let between = matches!(self.at, HUNTING | 0);
        let mine = target == self.local && len <= self.buf.as_ref().len();
        let plain = special_in([source, target, low, high]) == 0;
        (between && mine && plain && is_right(message, tail)).then_some((source, message, after))
    }

    /// Takes the bytes of a message that stand for themselves, as many as come one after another; what
    /// is left.
    fn plain<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        let Some(at) = self.at.checked_sub(HEADER).filter(|_| !self.escaped) else {
            return bytes;
        };
        let announced = self.announced();
        let room = self.buf.as_mut().get_mut(at..announced).unwrap_or_default();
        let (mut crc, mut rest) = (self.crc, bytes);
        for place in room {
            let Some((&byte, after)) = rest.split_first() else {
                break;
            };
            if matches!(byte, ESCAPE | BEGIN) {
                break;
            }
            *place = byte;
            crc = crc16(crc, byte);
            rest = after;
        }
        self.crc = crc;
        let taken = bytes.len().wrapping_sub(rest.len());
        self.at = self.at.wrapping_add(taken);
        rest
    }

    fn begin(&mut self) {
        if !matches!(self.at, HUNTING | 0) {
            count(&mut self.stats.cut);
        }
        self.at = 0;
        self.escaped = false;
        self.crc = 0;
    }

    fn announced(&self) -> usize {
        let [_, _, low, high] = self.header;
        usize::from(u16::from_le_bytes([low, high]))
    }

    /// One byte of a frame, unescaped; whether that makes the frame whole.
    fn step(&mut self, byte: u8) -> bool {
        let at = self.at;
        self.at = at.wrapping_add(1);
        if let Some(place) = self.header.get_mut(at) {
            *place = byte;
            if self.at == HEADER {
                self.look_at_header();
            }
            return false;
        }
        // Behind the message, what there is room for of its checksum is kept, too, and not looked at.
        let at = at.wrapping_sub(HEADER);
        if let Some(place) = self.buf.as_mut().get_mut(at) {
            *place = byte;
        }
        self.crc = crc16(self.crc, byte);
        if at <= self.announced() {
            return false;
        }
        self.at = HUNTING;
        let whole = self.crc == 0;
        count(if whole {
            &mut self.stats.frames
        } else {
            &mut self.stats.damaged
        });
        whole
    }

    /// Goes on hunting if the frame is for somebody else, or too long.
    fn look_at_header(&mut self) {
        let [_, target, _, _] = self.header;
        if target != self.local {
            count(&mut self.stats.not_mine);
        } else if self.announced() > self.buf.as_ref().len() {
            count(&mut self.stats.too_long);
        } else {
            return;
        }
        self.at = HUNTING;
    }
}

/// Whether a message and its checksum stand for themselves and fit each other; four bytes at a time.
fn is_right(message: &[u8], [low, high]: [u8; 2]) -> bool {
    let (words, end) = message.as_chunks();
    let (mut special, mut crc) = (special_in([low, high, low, high]), 0);
    for &word in words {
        special |= special_in(word);
        let acts = u32::from(crc) ^ u32::from_le_bytes(word);
        let [low, high, ..] = (0..4).fold(acts, |crc, _| shifted(crc)).to_le_bytes();
        crc = u16::from_le_bytes([low, high]);
    }
    for &byte in end {
        special |= u32::from(matches!(byte, 0x7c..=0x7f));
        crc = crc16(crc, byte);
    }
    special == 0 && crc == u16::from_le_bytes([low, high])
}

/// What four steps of the checksum make of four bits.
const STEPS: [u16; 16] = {
    let mut steps = [0; 16];
    let mut bits = 0_u16;
    while bits < 16 {
        let (mut crc, mut step) = (bits, 0);
        while step < 4 {
            crc = (crc >> 1) ^ (0xa001 * (crc & 1));
            step += 1;
        }
        if let Some(place) = steps.split_at_mut(bits as usize).1.first_mut() {
            *place = crc;
        }
        bits += 1;
    }
    steps
};

/// 0 if none of four bytes is 0x7C to 0x7F: four comparisons in one.
#[inline(always)]
const fn special_in(bytes: [u8; 4]) -> u32 {
    let zero = (u32::from_le_bytes(bytes) ^ 0x7c7c_7c7c) & 0xfcfc_fcfc;
    zero.wrapping_sub(0x0101_0101) & !zero & 0x8080_8080
}

/// CRC-16/ARC: polynomial 0x8005 reflected, from 0.
fn crc16(crc: u16, byte: u8) -> u16 {
    let [low, high, ..] = shifted(u32::from(crc ^ u16::from(byte))).to_le_bytes();
    u16::from_le_bytes([low, high])
}

/// The checksum's eight steps for the lowest byte, half of it at a time. What is above is not acted
/// on yet: bytes of the message that follow.
fn shifted(crc: u32) -> u32 {
    let half = |crc: u32| {
        let [low, ..] = crc.to_le_bytes();
        (crc >> 4) ^ u32::from(STEPS.get(usize::from(low & 15)).copied().unwrap_or(0))
    };
    half(half(crc))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;

    fn frame(message: &[u8]) -> Vec<u8> {
        let mut out = vec![0; serial_frame_len(message.len())];
        let len = serial_frame(SERIAL_CLIENT, SERIAL_AGENT, message, &mut out).unwrap();
        out.truncate(len);
        out
    }

    fn decode(line: &[u8], size: usize) -> (Vec<Vec<u8>>, FrameStats) {
        let mut decoder = Serial::new(SERIAL_AGENT, [0; 64]);
        let mut got = Vec::new();
        for piece in line.chunks(size) {
            decoder.push(piece, |_source, message| got.push(message.to_vec()));
        }
        (got, decoder.stats())
    }

    #[test]
    fn a_byte_at_once_is_eight_bits_one_after_another() {
        for crc in 0..=u16::MAX {
            let mut one_by_one = crc;
            for _ in 0..8 {
                let carry = one_by_one & 1;
                one_by_one = (one_by_one >> 1) ^ (carry * 0xa001);
            }
            assert_eq!(crc16(crc, 0), one_by_one, "from {crc:#x}");
            assert_eq!(crc16(crc ^ 0x5a, 0x5a), one_by_one);
        }
    }

    #[test]
    fn the_checksum_is_the_one_of_the_catalogue() {
        let crc = b"123456789".iter().fold(0, |crc, byte| crc16(crc, *byte));
        assert_eq!(crc, 0xbb3d);
    }

    #[test]
    fn a_frame_as_the_stock_client_sends_it() {
        let expected = [0x7e, 1, 0, 3, 0, 0x7d, 0x5e, 0x7d, 0x5d, 0xff];
        let line = frame(&[0x7e, 0x7d, 0xff]);
        assert_eq!(line[..10], expected);
        let mut decoder = Serial::new(SERIAL_AGENT, [0; 64]);
        let mut got = Vec::new();
        decoder.push(&line, |source, message| {
            got.push((source, message.to_vec()));
        });
        assert_eq!(got, [(SERIAL_CLIENT, vec![0x7e, 0x7d, 0xff])]);
    }

    #[test]
    fn every_byte_value_passes_in_pieces_of_every_size() {
        let messages: Vec<Vec<u8>> = (0..16_u8)
            .map(|i| (0..16).map(|j| i * 16 + j).collect())
            .collect();
        let line: Vec<u8> = messages.iter().flat_map(|m| frame(m)).collect();
        for size in [1, 2, 3, 7, 20, line.len()] {
            assert_eq!(decode(&line, size).0, messages);
        }
    }

    /// Any one byte changed, lost or put in costs at most the frame it is in and, if it was the
    /// beginning of a frame, nothing else.
    #[test]
    fn damage_costs_one_frame() {
        let messages: Vec<Vec<u8>> = (0..5_u8).map(|i| vec![i, 0x7e, 3, 0x7d, i, 0]).collect();
        let line: Vec<u8> = messages.iter().flat_map(|m| frame(m)).collect();
        for at in 0..line.len() {
            for value in [0x00, 0x01, 0x20, 0x7d, 0x7e, 0xff] {
                let mut changed = line.clone();
                changed[at] = value;
                let mut longer = line.clone();
                longer.insert(at, value);
                let mut shorter = line.clone();
                shorter.remove(at);
                for damaged in [changed, longer, shorter] {
                    let (got, _) = decode(&damaged, 5);
                    assert!(got.len() >= 4, "{at} {value:#x}: {got:?}");
                    assert!(got.iter().all(|message| messages.contains(message)));
                }
            }
        }
    }

    #[test]
    fn what_is_dropped_is_counted() {
        let mut line = vec![1, 2, 3];
        line.extend(&frame(&[5; 10])[..9]);
        line.extend(frame(&[6; 65]));
        let mut wrong = frame(&[7; 10]);
        wrong[7] ^= 1;
        line.extend(wrong);
        let mut other = [0; 64];
        let len = serial_frame(SERIAL_CLIENT, 9, &[8; 10], &mut other).unwrap();
        line.extend(&other[..len]);
        line.extend(frame(&[9; 10]));
        let (got, stats) = decode(&line, 4);
        assert_eq!(got, [vec![9; 10]]);
        assert_eq!((stats.frames, stats.damaged, stats.cut), (1, 1, 1));
        assert_eq!((stats.too_long, stats.not_mine), (1, 1));
        assert!(stats.noise >= 3);
    }

    #[test]
    fn a_buffer_that_is_too_short_is_an_error() {
        let mut out = [0; 12];
        assert_eq!(serial_frame(1, 0, &[1; 6], &mut out), Err(FrameTooShort));
        assert_eq!(serial_frame(1, 0, &[1; 5], &mut out), Ok(12));
    }
}
