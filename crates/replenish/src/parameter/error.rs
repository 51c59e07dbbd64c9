//! Reasons why a parameter was not declared, read or set.

use crate::platform::ShortText;
use core::fmt;

/// The kind of a parameter's error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ParameterErrorKind {
    /// There is no parameter of this name.
    Unknown,
    /// There is one already.
    Exists,
    /// A name that is empty or too long, or not allowed.
    Name,
    /// There may be no more parameters.
    TooMany,
    /// The value takes more bytes than values may.
    TooLarge,
    /// The value is of another type.
    Type,
    /// The value is outside the range.
    Range,
    /// The parameter is read-only.
    ReadOnly,
    /// A callback has refused it.
    Refused,
    /// A callback of setting a parameter set one.
    Nested,
}

/// Reason why a parameter was not declared, read or set; the text names the parameter and what is
/// allowed. Made without allocation; a text of more than 120 bytes is cut.
#[derive(Clone, Copy)]
pub struct ParameterError {
    kind: ParameterErrorKind,
    text: ShortText,
}

impl ParameterError {
    pub(crate) fn new(kind: ParameterErrorKind, text: fmt::Arguments<'_>) -> Self {
        let text = ShortText::of(&text);
        Self { kind, text }
    }

    pub(crate) fn unknown(name: &str) -> Self {
        let kind = ParameterErrorKind::Unknown;
        Self::new(kind, format_args!("{name}: no such parameter"))
    }

    /// The kind of the error, for programs.
    #[must_use]
    pub fn kind(&self) -> ParameterErrorKind {
        self.kind
    }

    /// The error in words, for people: the `reason` in responses.
    #[must_use]
    pub fn reason(&self) -> &str {
        self.text.as_str()
    }
}

impl fmt::Display for ParameterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.reason())
    }
}

impl fmt::Debug for ParameterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}({:?})", self.kind, self.reason())
    }
}

impl core::error::Error for ParameterError {}
