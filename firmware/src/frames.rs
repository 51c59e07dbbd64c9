//! Counts the samples in the stock serial framing as it goes by, for [`crate::line`]: DATA
//! submessages (DDS-XRCE 8.3.5.10), of which a message may have several.

const BEGIN: u8 = 0x7e;
const ESCAPE: u8 = 0x7d;
const DATA: u8 = 9;
const LONGEST: usize = 600;

/// A frame on its way: 4 bytes of addresses and length, the message, 2 bytes of checksum.
pub struct Frames {
    bytes: [u8; LONGEST],
    len: usize,
    escaped: bool,
}

impl Frames {
    /// Nothing has come yet.
    pub const fn new() -> Self {
        Self {
            bytes: [0; LONGEST],
            len: LONGEST,
            escaped: false,
        }
    }

    /// Takes the next byte; how many samples the frame has that it ends.
    pub fn push(&mut self, byte: u8) -> u32 {
        if byte == BEGIN {
            self.len = 0;
            self.escaped = false;
            return 0;
        }
        if byte == ESCAPE {
            self.escaped = true;
            return 0;
        }
        let byte = if core::mem::take(&mut self.escaped) {
            byte ^ 0x20
        } else {
            byte
        };
        if self.len >= LONGEST {
            return 0; // between frames, or in one that is too long
        }
        self.bytes[self.len] = byte;
        self.len += 1;
        let message = usize::from(u16::from_le_bytes([self.bytes[2], self.bytes[3]]));
        if self.len < 4 || self.len != message + 6 {
            return 0;
        }
        self.len = LONGEST;
        self.bytes.get(4..message + 4).map_or(0, samples)
    }
}

impl Default for Frames {
    fn default() -> Self {
        Self::new()
    }
}

/// DATA submessages of a message.
fn samples(message: &[u8]) -> u32 {
    let header = match message.first() {
        Some(session) if *session < 0x80 => 8, // with the client's key
        _ => 4,
    };
    let mut rest = message.get(header..).unwrap_or(&[]);
    let mut count = 0;
    while let [id, _, low, high, ..] = rest {
        count += u32::from(*id == DATA);
        let len = usize::from(u16::from_le_bytes([*low, *high]));
        rest = rest.get((4 + len).next_multiple_of(4)..).unwrap_or(&[]);
    }
    count
}
