//! An answer that is no budget: which kind it is, and the sentence for the user.

use replenish_os::foreign::ForeignError;
use std::fmt;

/// The kinds of failures, which programs tell apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Why {
    /// An argument is out of its range.
    Invalid,
    /// The budget does not fit beside the others.
    Refused,
    /// A privilege is missing.
    NotPermitted,
    /// There is no such budget, no such thread in this process, or no budget for this name.
    NotFound,
    /// The thread has a budget already.
    Busy,
    /// No room is left.
    Full,
    /// This library or this system cannot do it.
    Unsupported,
    /// The system refused something.
    System,
    /// The process is a fork of the one that made the budgets.
    Forked,
}

/// A failure; its text says what to do.
#[derive(Clone, PartialEq, Eq)]
pub struct Failure {
    /// Its kind.
    pub why: Why,
    /// The sentence.
    pub text: String,
}

impl Failure {
    /// A failure of this kind.
    pub fn new(why: Why, text: impl fmt::Display) -> Self {
        Self {
            why,
            text: text.to_string(),
        }
    }

    /// An argument out of its range.
    pub fn invalid(text: impl fmt::Display) -> Self {
        Self::new(Why::Invalid, text)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// The sentence as well: a `main` that fails prints this.
impl fmt::Debug for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}: {}", self.why, self.text)
    }
}

impl std::error::Error for Failure {}

impl From<ForeignError> for Failure {
    fn from(error: ForeignError) -> Self {
        let why = match &error {
            e if e.is_permission() => Why::NotPermitted,
            e if e.is_gone() => Why::NotFound,
            ForeignError::NotOwn { .. } => Why::NotFound,
            ForeignError::Enrolled { .. } | ForeignError::Worker { .. } => Why::Busy,
            ForeignError::Full { .. } => Why::Full,
            ForeignError::Deadline { .. } | ForeignError::Above { .. } => Why::Unsupported,
            ForeignError::Refused { .. } | ForeignError::NoEnforcer => Why::System,
            _ => Why::Invalid,
        };
        Self::new(why, error)
    }
}
