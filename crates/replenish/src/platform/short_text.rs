//! Texts of fixed size, for places where nothing may be allocated. Empty without feature `texts`.

use super::TEXTS;
use core::fmt;

/// The longest [`ShortText`] in bytes.
const LONGEST: usize = if TEXTS { 120 } else { 0 };

/// A short text written without allocation and cut off at 120 bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ShortText {
    bytes: [u8; LONGEST],
    len: u8,
}

impl ShortText {
    pub(crate) const EMPTY: Self = Self {
        bytes: [0; LONGEST],
        len: 0,
    };

    pub(crate) fn of(value: &dyn fmt::Display) -> Self {
        let mut text = Self::EMPTY;
        if LONGEST == 0 {
            return text;
        }
        // Truncation ends the writing with an error, as intended.
        let _truncated = fmt::Write::write_fmt(&mut text, format_args!("{value}")).is_err();
        text
    }

    pub(crate) fn as_str(&self) -> &str {
        let bytes = self.bytes.get(..self.len.into()).unwrap_or_default();
        core::str::from_utf8(bytes).unwrap_or_default()
    }
}

impl fmt::Write for ShortText {
    fn write_str(&mut self, s: &str) -> fmt::Result {
        let room = self.bytes.get_mut(self.len.into()..).unwrap_or_default();
        let mut n = s.len().min(room.len());
        while !s.is_char_boundary(n) {
            n -= 1;
        }
        for (to, from) in room.iter_mut().zip(s.bytes().take(n)) {
            *to = from;
        }
        self.len += u8::try_from(n).unwrap_or(0); // at most 120
        if n < s.len() { Err(fmt::Error) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_cut_at_a_character() {
        assert_eq!(ShortText::of(&"short").as_str(), "short");
        assert_eq!(ShortText::of(&"x".repeat(200)).as_str().len(), 120);
        let wide = "ä".repeat(59) + "xä!"; // the 120th byte is in the middle of the last ä
        assert_eq!(ShortText::of(&wide).as_str(), "ä".repeat(59) + "x");
    }
}
