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

use super::checksum::{SPECIAL, checked, checksum, special_in};
use crate::counter::{count, count_inline};
use core::fmt;

const BEGIN: u8 = 0x7e;
const ESCAPE: u8 = 0x7d;
const FLIP: u8 = 0x20;

/// The address agents have on a serial line.
pub const SERIAL_AGENT: u8 = 0;
/// The default address of clients on a serial line.
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
    let crc = checksum(message);
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

/// The counters of a [`Serial`].
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
    /// Frames for another address.
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
    /// The checksum behind the message.
    tail: [u8; 2],
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
            tail: [0; 2],
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

    /// The counters so far.
    pub const fn stats(&self) -> FrameStats {
        self.stats
    }

    /// Takes in bytes of the line; calls `deliver` with the sender's address and the message of
    /// each frame that ends in them unharmed.
    pub fn push(&mut self, mut bytes: &[u8], mut deliver: impl FnMut(u8, &[u8])) {
        while !bytes.is_empty() {
            if let Some((source, message, rest)) = self.whole(bytes) {
                self.at = HUNTING;
                count_inline(&mut self.stats.frames);
                deliver(source, message);
                bytes = rest;
                continue;
            }
            let ended;
            (bytes, ended) = self.piecewise(bytes);
            if ended {
                let [source, ..] = self.header;
                let message = self.buf.as_ref().get(..self.announced()).unwrap_or(&[]);
                deliver(source, message);
            }
        }
    }

    /// Takes bytes up to the end of a frame; returns the rest, and whether the frame is unharmed.
    #[inline(never)]
    fn piecewise<'a>(&mut self, mut bytes: &'a [u8]) -> (&'a [u8], bool) {
        loop {
            bytes = self.plain(bytes);
            let Some((&byte, rest)) = bytes.split_first() else {
                return (bytes, false);
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
                let ended = self.step(byte ^ flip);
                if ended || self.at == HUNTING {
                    return (bytes, ended);
                }
            }
        }
    }

    /// The frame that `bytes` begin with, if it is there as a whole, unharmed, and all its bytes
    /// stand for themselves, as in most: its sender, its message where it lies, and what follows
    /// it.
    fn whole<'a>(&self, bytes: &'a [u8]) -> Option<(u8, &'a [u8], &'a [u8])> {
        let (&[BEGIN, ref header @ ..], rest) = bytes.split_first_chunk::<5>()? else {
            return None;
        };
        let [source, target, low, high] = *header;
        let len = usize::from(u16::from_le_bytes([low, high]));
        let (message, rest) = rest.split_at_checked(len)?;
        let (&tail, after) = rest.split_first_chunk()?;
        let between = matches!(self.at, HUNTING | 0);
        let mine = target == self.local && len <= self.buf.as_ref().len();
        let plain = special_in(u32::from_le_bytes(*header)) & SPECIAL == 0;
        (between && mine && plain && is_right(message, tail)).then_some((source, message, after))
    }

    /// Takes the bytes of a message that stand for themselves, as many as come one after another;
    /// what is left.
    fn plain<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        let Some(at) = self.at.checked_sub(HEADER).filter(|_| !self.escaped) else {
            return bytes;
        };
        let announced = self.announced();
        let room = self.buf.as_mut().get_mut(at..announced).unwrap_or_default();
        let mut rest = bytes;
        for place in room {
            let Some((&byte, after)) = rest.split_first() else {
                break;
            };
            if matches!(byte, ESCAPE | BEGIN) {
                break;
            }
            *place = byte;
            rest = after;
        }
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
    }

    fn announced(&self) -> usize {
        let [_, _, low, high] = self.header;
        usize::from(u16::from_le_bytes([low, high]))
    }

    /// Takes one byte of a frame, unescaped; whether that makes the frame whole.
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
        let (at, announced) = (at.wrapping_sub(HEADER), self.announced());
        let message = self.buf.as_mut().get_mut(..announced).unwrap_or_default();
        if let Some(place) = message.get_mut(at) {
            *place = byte;
            return false;
        }
        let [low, high] = &mut self.tail;
        if at == announced {
            *low = byte;
            return false;
        }
        *high = byte;
        self.at = HUNTING;
        let whole = checksum(message).to_le_bytes() == self.tail;
        count(if whole {
            &mut self.stats.frames
        } else {
            &mut self.stats.damaged
        });
        whole
    }

    /// Goes on hunting if the frame is for another address, or too long.
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

/// Whether a message and its checksum stand for themselves and fit each other.
fn is_right(message: &[u8], tail: [u8; 2]) -> bool {
    let (crc, special) = checked(message);
    let sent = u16::from_le_bytes(tail);
    let special = special | special_in(sent.into()) & SPECIAL;
    crc == sent && special == 0
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
