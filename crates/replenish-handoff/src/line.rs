//! A line of a log as words: a real-time thread writes them, an ordinary one reads them.

use core::fmt;

/// Words of a line in the queue: the stamp, the numbers, the text.
pub const LINE_WORDS: usize = 60;
/// The longest text in bytes; a longer one is cut and ends in `…`.
pub const LINE_TEXT: usize = (LINE_WORDS - 2) * 8;
const DOTS: &str = "…";

/// Everything of a line but its text. The user gives the numbers their meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineHead {
    /// The wall clock in nanoseconds since 1970.
    pub stamp: u64,
    /// The severity.
    pub level: u8,
    /// The logger's number.
    pub logger: u16,
    /// The number of the place in the source.
    pub site: u16,
}

/// A line that is being written, on the stack of its thread.
pub struct LineDraft {
    bytes: [u8; LINE_TEXT],
    len: usize,
}

impl LineDraft {
    /// Formats the text.
    #[must_use]
    pub fn of(text: fmt::Arguments<'_>) -> Self {
        let mut draft = Self {
            bytes: [0; LINE_TEXT],
            len: 0,
        };
        if fmt::Write::write_fmt(&mut draft, text).is_err() && draft.is_nearly_full() {
            draft.cut();
        }
        draft
    }

    /// The writing ended for want of room, not by an error of the program's own.
    const fn is_nearly_full(&self) -> bool {
        self.len + 4 > LINE_TEXT
    }

    fn cut(&mut self) {
        let text = core::str::from_utf8(self.bytes.get(..self.len).unwrap_or_default());
        let end = text.map_or(0, |text| text.floor(LINE_TEXT - DOTS.len()));
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
    #[must_use]
    pub fn words(&self, head: LineHead) -> ([u64; LINE_WORDS], usize) {
        let mut words = [0; LINE_WORDS];
        let [stamp, numbers, text @ ..] = &mut words;
        *stamp = head.stamp;
        *numbers = u64::from(head.level)
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

impl fmt::Write for LineDraft {
    fn write_str(&mut self, s: &str) -> fmt::Result {
        let end = s.floor(LINE_TEXT - self.len);
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

/// The line that these words are, its text in `room`.
#[must_use]
pub fn read_line<'a>(
    words: &[u64; LINE_WORDS],
    room: &'a mut [u8; LINE_TEXT],
) -> (LineHead, &'a str) {
    let [stamp, numbers, text @ ..] = words;
    let part = |from: u32| (numbers >> from & 0xffff) as u16;
    let head = LineHead {
        stamp: *stamp,
        level: (numbers & 0xff) as u8,
        logger: part(8),
        site: part(24),
    };
    let bytes = text.iter().flat_map(|word| word.to_le_bytes());
    for (to, from) in room.iter_mut().zip(bytes) {
        *to = from;
    }
    let text = room.get(..usize::from(part(40))).unwrap_or_default();
    (head, core::str::from_utf8(text).unwrap_or_default())
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use alloc::string::String;

    fn back(text: &str) -> String {
        let head = LineHead {
            stamp: u64::MAX,
            level: 50,
            logger: 4095,
            site: u16::MAX,
        };
        let (words, used) = LineDraft::of(format_args!("{text}")).words(head);
        assert!(words.iter().skip(used).all(|word| *word == 0));
        let mut room = [0; LINE_TEXT];
        let (same, text) = read_line(&words, &mut room);
        assert_eq!(same, head);
        text.into()
    }

    #[test]
    fn a_line_comes_back_and_a_long_one_is_cut_at_a_character() {
        for text in ["", "x", "12345678", "größer"] {
            assert_eq!(back(text), text);
        }
        let fits = "x".repeat(LINE_TEXT);
        assert_eq!(back(&fits), fits);
        let cut = "x".repeat(LINE_TEXT - 3) + "…";
        assert_eq!(back(&("x".repeat(LINE_TEXT) + "y")), cut);
        let wide = "ä".repeat(LINE_TEXT); // the 461st byte is in the middle of an ä
        assert_eq!(back(&wide), "ä".repeat((LINE_TEXT - 3) / 2) + "…");
    }
}
