//! Exit codes of commands, and the sentence that goes with each.
//!
//! 0: it did what was asked. 1: it could not, and says why. 2: the command line was wrong
//! (clap's own errors use the same code). `replenish run` ends with the code of its program.

use std::fmt;
use std::process::ExitCode;

/// Reason why a command did not do what was asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// The machine, the network or the other side said no: exit code 1.
    Refused(String),
    /// An option has a value that cannot be: exit code 2.
    Usage(String),
    /// The program that was run ended with this code, and has said why itself.
    Program(u8),
}

impl Failure {
    /// An exit with code 1.
    pub fn refused(why: impl fmt::Display) -> Self {
        Self::Refused(why.to_string())
    }

    /// An exit with code 2: names the option and the range it must lie in.
    pub fn range(option: &str, value: impl fmt::Display, allowed: impl fmt::Display) -> Self {
        Self::Usage(format!(
            "invalid value '{value}' for '{option}': allowed is {allowed}"
        ))
    }

    /// Adds what was being done: `what: why`.
    pub fn context(self, what: impl fmt::Display) -> Self {
        match self {
            Self::Refused(why) => Self::Refused(format!("{what}: {why}")),
            Self::Usage(why) => Self::Usage(format!("{what}: {why}")),
            Self::Program(code) => Self::Program(code),
        }
    }

    /// The process's exit code.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Refused(_) => ExitCode::from(1),
            Self::Usage(_) => ExitCode::from(2),
            Self::Program(code) => ExitCode::from(*code),
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Refused(why) | Self::Usage(why) => f.write_str(why),
            Self::Program(code) => write!(f, "the program ended with status {code}"),
        }
    }
}

impl std::error::Error for Failure {}

/// The result of a command.
pub type Outcome = Result<(), Failure>;

/// Says why a command failed, if it did; the process's exit code.
#[must_use]
pub fn end(outcome: Outcome) -> ExitCode {
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure @ Failure::Program(_)) => failure.exit_code(),
        Err(failure) => {
            eprintln!("replenish: {failure}");
            failure.exit_code()
        }
    }
}
