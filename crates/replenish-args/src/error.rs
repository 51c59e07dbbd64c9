//! An argument that cannot be used.

use std::fmt;

/// The place, the argument, and what is allowed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ArgsError {
    /// Where: `argument 3`, `robot.yaml:4:7`, `ROS_DOMAIN_ID`.
    pub place: String,
    /// The text that was written there.
    pub text: String,
    /// The problem, and what is allowed.
    pub problem: String,
}

impl ArgsError {
    pub(crate) fn new(
        place: impl Into<String>,
        text: impl Into<String>,
        problem: impl Into<String>,
    ) -> Self {
        Self {
            place: place.into(),
            text: text.into(),
            problem: problem.into(),
        }
    }

    /// An error about the argument with this index; 0 is the program's name.
    pub(crate) fn argument(index: usize, text: &str, problem: impl Into<String>) -> Self {
        Self::new(format!("argument {index}"), text, problem)
    }
}

impl fmt::Display for ArgsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.place)?;
        if !self.text.is_empty() {
            write!(f, ", {}", self.text)?;
        }
        write!(f, ": {}", self.problem)
    }
}

impl std::error::Error for ArgsError {}
