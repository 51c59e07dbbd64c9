//! In the place of `text` without feature `texts`: every text is empty and takes no memory.

use core::fmt;

/// The place of a text in builds without feature `texts`: always the empty string.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct Text;

/// The place of a text that stands in the program: always the empty string.
pub type StaticText = Text;

impl From<&str> for Text {
    fn from(_: &str) -> Self {
        Self
    }
}

impl From<alloc::string::String> for Text {
    fn from(_: alloc::string::String) -> Self {
        Self
    }
}

impl core::ops::Deref for Text {
    type Target = str;

    fn deref(&self) -> &str {
        ""
    }
}

impl fmt::Display for Text {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        Ok(())
    }
}

impl fmt::Debug for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("\"\"")
    }
}

/// Formats nothing; the arguments count as used.
macro_rules! text {
    ($($arguments:tt)*) => {{
        let _ = format_args!($($arguments)*);
        $crate::platform::Text
    }};
}
pub(crate) use text;

pub(crate) const fn label(_: &'static str) -> StaticText {
    Text
}

pub(crate) fn displayed(_: &impl fmt::Display) -> &dyn fmt::Display {
    &Text
}

pub(crate) const fn join(_: &[Text], _: &str) -> Text {
    Text
}
