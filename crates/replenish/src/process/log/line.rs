//! A line of the log as words: what a real-time thread writes, and the writer's thread reads.

use core::fmt;
use replenish_args::LogLevel;

/// Words of a line in the queue: the stamp, the numbers, the text.
pub(super) const WORDS: usize = 60;
/// The longest text in bytes; a longer one is cut and ends in `…`.
pub(super) const LONGEST: usize = (WORDS - 2) * 8;
const DOTS: &str = "…";

/// Everything but the text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Head {
    /// The wall clock in nanoseconds since 1970.
    pub(super) stamp: u64,
    pub(super) level: LogLevel,
    /// The logger's place in the table.
    pub(super) logger: u16,
    /// The site's number.
    pub(super) site: u16,
}

/// A line that is being written, on the stack of its thread.
pub(super) struct Draft {
    bytes: [u8; LONGEST],
    len: usize,
}

impl Draft {
    pub(super) fn of(text: fmt::Arguments<'_>) -> Self {
        let mut draft = Self {
            bytes: [0; LONGEST],
            len: 0,
        };
        if fmt::Write::write_fmt(&mut draft, text).is_err() && draft.is_nearly_full() {
            draft.cut();
        }
        draft
    }

    /// The writing ended for want of room, not by an error of the program's own.
    const fn is_nearly_full(&self) -> bool {
        self.len + 4 > LONGEST
    }

    fn cut(&mut self) {
        let text = core::str::from_utf8(self.bytes.get(..self.len).unwrap_or_default());
        let end = text.map_or(0, |text| text.floor(LONGEST - DOTS.len()));
        self.len = end;
        self.put(DOTS.as_bytes());
    }

    fn put(&mut self, bytes: &[u8]) {
        let room = self.bytes.get_mut(self.len..).unwrap_or_default();
        for (to, from) in room.iter_mut().zip(bytes) {
            *to = *from;
            self.len += 1;
        }
    }

    /// As words, and how many of them.
    pub(super) fn words(&self, head: Head) -> ([u64; WORDS], usize) {
        let mut words = [0; WORDS];
        let [stamp, numbers, text @ ..] = &mut words;
        *stamp = head.stamp;
        *numbers = u64::from(head.level.number())
            | u64::from(head.logger) << 8
            | u64::from(head.site) << 24
            | (self.len as u64) << 40;
        let bytes = self.bytes.get(..self.len).unwrap_or_default();
        for (word, bytes) in text.iter_mut().zip(bytes.chunks(8)) {
            let mut whole = [0; 8];
            for (to, from) in whole.iter_mut().zip(bytes) {
                *to = *from;
            }
            *word = u64::from_le_bytes(whole);
        }
        (words, 2 + self.len.div_ceil(8))
    }
}

impl fmt::Write for Draft {
    fn write_str(&mut self, s: &str) -> fmt::Result {
        let end = s.floor(LONGEST - self.len);
        self.put(s.as_bytes().get(..end).unwrap_or_default());
        if end < s.len() {
            Err(fmt::Error)
        } else {
            Ok(())
        }
    }
}

trait Floor {
    /// The largest boundary of a character up to `most`.
    fn floor(&self, most: usize) -> usize;
}

impl Floor for str {
    fn floor(&self, most: usize) -> usize {
        let mut end = most.min(self.len());
        while !self.is_char_boundary(end) {
            end -= 1;
        }
        end
    }
}

/// The line that these words are, its text in `room`; `None` if its level makes no sense.
pub(super) fn read<'a>(
    words: &[u64; WORDS],
    room: &'a mut [u8; LONGEST],
) -> Option<(Head, &'a str)> {
    let [stamp, numbers, text @ ..] = words;
    let part = |from: u32| (numbers >> from & 0xffff) as u16;
    let head = Head {
        stamp: *stamp,
        level: LogLevel::numbered((numbers & 0xff) as u32)?,
        logger: part(8),
        site: part(24),
    };
    let bytes = text.iter().flat_map(|word| word.to_le_bytes());
    for (to, from) in room.iter_mut().zip(bytes) {
        *to = from;
    }
    let text = room.get(..usize::from(part(40))).unwrap_or_default();
    Some((head, core::str::from_utf8(text).unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn back(text: &str) -> String {
        let head = Head {
            stamp: u64::MAX,
            level: LogLevel::Fatal,
            logger: 4095,
            site: u16::MAX,
        };
        let (words, used) = Draft::of(format_args!("{text}")).words(head);
        assert!(words.iter().skip(used).all(|word| *word == 0));
        let mut room = [0; LONGEST];
        let (same, text) = read(&words, &mut room).unwrap();
        assert_eq!(same, head);
        text.into()
    }

    #[test]
    fn a_line_comes_back_and_a_long_one_is_cut_at_a_character() {
        for text in ["", "x", "12345678", "größer als vorher"] {
            assert_eq!(back(text), text);
        }
        let fits = "x".repeat(LONGEST);
        assert_eq!(back(&fits), fits);
        let cut = "x".repeat(LONGEST - 3) + "…";
        assert_eq!(back(&("x".repeat(LONGEST) + "y")), cut);
        let wide = "ä".repeat(LONGEST); // the 461st byte is in the middle of an ä
        assert_eq!(back(&wide), "ä".repeat((LONGEST - 3) / 2) + "…");
    }
}
