//! Texts of fixed size, for places where nothing may be allocated. Empty without feature `texts`.

use super::TEXTS;
use core::fmt;

/// The longest [`ShortText`] in bytes.
const LONGEST: usize = if TEXTS { 120 } else { 0 };

/// A short text written without allocation and cut off at 120 bytes: then it ends
/// in `…`, and not in the middle of a number.
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
        if fmt::Write::write_fmt(&mut text, format_args!("{value}")).is_err() {
            text.mark_cut();
        }
        text
    }

    /// Makes room for the mark of a cut. A part of a number would read as another number.
    fn mark_cut(&mut self) {
        let mark = "…";
        let kept = self.as_str();
        let mut end = LONGEST.saturating_sub(mark.len());
        while !kept.is_char_boundary(end) {
            end -= 1;
        }
        let kept = kept.get(..end).unwrap_or_default();
        let kept = kept.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.');
        self.len = u8::try_from(kept.len()).unwrap_or(0); // below 120
        let _fits = fmt::Write::write_str(self, mark).is_ok();
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
        let whole = "x".repeat(120);
        assert_eq!(ShortText::of(&whole).as_str(), whole);
        let cut = "x".repeat(117) + "…";
        assert_eq!(ShortText::of(&"x".repeat(200)).as_str(), cut);
        let wide = "ä".repeat(61); // the 117th byte is in the middle of an ä
        assert_eq!(ShortText::of(&wide).as_str(), "ä".repeat(58) + "…");
        let number = "x".repeat(112) + " 1234567.8 ms";
        assert_eq!(ShortText::of(&number).as_str(), "x".repeat(112) + " …");
    }
}
