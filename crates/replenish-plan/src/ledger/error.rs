//! Reasons that keep a program from being admitted.

use crate::Refusal;
use std::fmt;
use std::path::{Path, PathBuf};

/// A file or directory of the ledger that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LedgerError {
    /// The file or directory.
    pub path: PathBuf,
    /// Why.
    pub reason: String,
}

impl LedgerError {
    pub(super) fn new(path: &Path, reason: impl Into<String>) -> Self {
        Self {
            path: path.into(),
            reason: reason.into(),
        }
    }
}

impl fmt::Display for LedgerError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ledger {}: {}", self.path.display(), self.reason)
    }
}

impl std::error::Error for LedgerError {}

/// A program that was not admitted.
#[derive(Debug, Clone, PartialEq)]
pub enum Denied {
    /// The request does not fit.
    Refused(Refusal),
    /// The ledger cannot be used.
    Ledger(LedgerError),
}

impl fmt::Display for Denied {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Refused(refusal) => refusal.fmt(f),
            Self::Ledger(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for Denied {}

impl From<Refusal> for Denied {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

impl From<LedgerError> for Denied {
    fn from(error: LedgerError) -> Self {
        Self::Ledger(error)
    }
}
