//! Errors in interface files, with their place.

use std::fmt;
use std::path::{Path, PathBuf};

/// Reason why nothing was generated: the place, what is wrong with it, and what is allowed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    file: PathBuf,
    place: Place,
    message: String,
}

/// A line and a column, both from 1 and the column in characters; 0 for the file as a whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// The line.
    pub line: usize,
    /// The column.
    pub column: usize,
}

impl Error {
    pub(crate) fn at(file: &Path, place: Place, message: impl Into<String>) -> Self {
        Self {
            file: file.into(),
            place,
            message: message.into(),
        }
    }

    /// Adds that the error is about the value of this field or constant.
    pub(crate) fn about(self, what: &str, name: &str) -> Self {
        Self {
            message: format!("{} ({what} `{name}`)", self.message),
            ..self
        }
    }

    /// About a file or directory as a whole.
    pub(crate) fn whole(file: &Path, message: impl Into<String>) -> Self {
        Self::at(file, Place::default(), message)
    }

    /// The file, or the directory.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// Place in the file.
    #[must_use]
    pub fn place(&self) -> Place {
        self.place
    }

    /// The error, with the allowed values.
    #[must_use]
    pub fn message(&self) -> &str {
        &self.message
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if self.place.line > 0 {
            write!(f, ":{}:{}", self.place.line, self.place.column)?;
        }
        write!(f, ": {}", self.message)
    }
}

impl std::error::Error for Error {}
