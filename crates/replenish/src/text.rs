//! Texts of errors, events and reports, which builds without feature `texts` leave out: then the
//! strings are empty, and what a program can act on (kind, field, number) is all there is. Names
//! are put together here, too, without the formatting that would bring kilobytes of code.

use alloc::string::String;
use core::fmt;
use replenish_msg::{CdrReader, DecodeError, Message};

/// Words for people: a `String`, and nothing without feature `texts`.
#[cfg(feature = "texts")]
pub type Words = String;
#[cfg(not(feature = "texts"))]
pub use wordless::Words;

/// Words for people that stand in the program; nothing without feature `texts`.
#[cfg(feature = "texts")]
pub type Label = &'static str;
/// The place of words in builds without feature `texts`.
#[cfg(not(feature = "texts"))]
pub type Label = Words;

#[cfg(not(feature = "texts"))]
mod wordless {
    use core::fmt;

    /// The place of words in builds without feature `texts`: always the empty string.
    #[derive(Clone, Default, PartialEq, Eq)]
    pub struct Words;

    impl From<&str> for Words {
        fn from(_: &str) -> Self {
            Self
        }
    }

    impl From<alloc::string::String> for Words {
        fn from(_: alloc::string::String) -> Self {
            Self
        }
    }

    impl core::ops::Deref for Words {
        type Target = str;

        fn deref(&self) -> &str {
            ""
        }
    }

    impl fmt::Display for Words {
        fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
            Ok(())
        }
    }

    impl fmt::Debug for Words {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("\"\"")
        }
    }
}

/// As `format!`; no words without feature `texts`.
#[cfg(feature = "texts")]
macro_rules! text {
    ($($arguments:tt)*) => { alloc::format!($($arguments)*) };
}
#[cfg(not(feature = "texts"))]
macro_rules! text {
    ($($arguments:tt)*) => {{
        let _ = format_args!($($arguments)*);
        $crate::text::Words
    }};
}
pub(crate) use text;

/// A label with these words; an empty one without feature `texts`.
#[cfg(feature = "texts")]
pub(crate) const fn said(words: &'static str) -> Label {
    words
}
#[cfg(not(feature = "texts"))]
pub(crate) const fn said(_: &'static str) -> Label {
    Words
}

/// What is handed to code that may format it: `value`, or nothing without feature `texts`.
pub(crate) fn shown(value: &impl fmt::Display) -> &dyn fmt::Display {
    match cfg!(feature = "texts") {
        true => value,
        false => &Nothing,
    }
}

struct Nothing;

impl fmt::Display for Nothing {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        Ok(())
    }
}

/// All of them in a row.
#[cfg(feature = "texts")]
pub(crate) fn list(words: &[Words], between: &str) -> Words {
    words.join(between)
}

/// No words.
#[cfg(not(feature = "texts"))]
pub(crate) const fn list(_: &[Words], _: &str) -> Words {
    Words
}

/// Decodes a payload; an error names the field only with feature `texts`.
pub(crate) fn decode<M: Message>(to: &mut M, from: &CdrReader<'_>) -> Result<(), DecodeError> {
    match cfg!(feature = "texts") {
        true => replenish_msg::decode_located(to, from),
        false => replenish_msg::decode_whole(to, from),
    }
}

/// The parts, one after another.
pub(crate) fn joined(parts: &[&str]) -> String {
    let mut all = String::with_capacity(parts.iter().map(|part| part.len()).sum());
    parts.iter().for_each(|part| all.push_str(part));
    all
}

/// `stem` and a number in decimal.
pub(crate) fn numbered(stem: &str, number: usize) -> String {
    let mut all = match number / 10 {
        0 => joined(&[stem]),
        before => numbered(stem, before),
    };
    let digit = u8::try_from(number % 10).unwrap_or(0);
    all.push(char::from(b'0' + digit));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_decimal() {
        for n in [0, 7, 10, 4096, usize::MAX] {
            assert_eq!(numbered("a#", n), format!("a#{n}"));
        }
        assert_eq!(joined(&["/n", "/sub:", "/t"]), "/n/sub:/t");
    }
}
