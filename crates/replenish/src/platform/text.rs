//! Texts of errors, events and reports. `text_disabled.rs` takes this file's place without feature
//! `texts`.

use alloc::string::String;
use core::fmt;

/// A text for people; always empty without feature `texts`.
pub type Text = String;

/// A text for people that stands in the program; always empty without feature `texts`.
pub type StaticText = &'static str;

/// A [`Text`] made as `format!` makes a `String`.
macro_rules! text {
    ($($arguments:tt)*) => { alloc::format!($($arguments)*) };
}
pub(crate) use text;

/// The text of an error or report that stands in the program.
pub(crate) const fn label(text: &'static str) -> StaticText {
    text
}

/// The value as it is handed to code that may format it.
pub(crate) fn displayed(value: &impl fmt::Display) -> &dyn fmt::Display {
    value
}

/// The texts in a row, with `between` between each two.
pub(crate) fn join(texts: &[Text], between: &str) -> Text {
    texts.join(between)
}
