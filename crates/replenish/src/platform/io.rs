//! Errors of transports in builds without the standard library: kind and number, with the names
//! they have there.

use core::fmt;

/// The kind of an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The operation would have to wait.
    WouldBlock,
    /// A signal came first.
    Interrupted,
    /// A parameter is out of its range.
    InvalidInput,
    /// Nothing more could be written.
    WriteZero,
    /// There is no such thing.
    NotFound,
    /// Any other.
    Other,
}

/// An error of a transport or of the system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Error {
    kind: ErrorKind,
    /// 0 for none.
    number: i32,
}

/// The result of a transport's operation.
pub type Result<T> = core::result::Result<T, Error>;

impl Error {
    /// The system's error with this number, which is not 0.
    #[must_use]
    pub const fn from_raw_os_error(number: i32) -> Self {
        Self {
            kind: ErrorKind::Other,
            number,
        }
    }

    /// The system's number, if the error is the system's.
    #[must_use]
    pub const fn raw_os_error(&self) -> Option<i32> {
        match self.number {
            0 => None,
            number => Some(number),
        }
    }

    /// Its kind.
    #[must_use]
    pub const fn kind(&self) -> ErrorKind {
        self.kind
    }
}

impl From<ErrorKind> for Error {
    fn from(kind: ErrorKind) -> Self {
        Self { kind, number: 0 }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.number {
            0 => f.write_str("input/output error"),
            number => write!(f, "error {number}"),
        }
    }
}

impl core::error::Error for Error {}
