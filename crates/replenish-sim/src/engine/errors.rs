//! Reasons why a run cannot go on.

use crate::{Nanos, SpecError};
use core::fmt;

/// Reason why a run did not come to its end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SimError {
    /// The system is not valid.
    Spec(SpecError),
    /// The thread waits for a lock whose owner waits, over some steps, for the thread.
    Deadlock {
        /// When, in ns.
        time: Nanos,
        /// The name of the thread that closed the circle.
        thread: String,
    },
    /// Threads keep releasing each other without consuming CPU time.
    Livelock {
        /// When, in ns.
        time: Nanos,
        /// The name of one of them.
        thread: String,
    },
}

impl fmt::Display for SimError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Spec(error) => error.fmt(f),
            Self::Deadlock { time, thread } => {
                write!(
                    f,
                    "deadlock at {time} ns: thread \"{thread}\" waits for itself"
                )
            }
            Self::Livelock { time, thread } => write!(
                f,
                "at {time} ns thread \"{thread}\" and others release each other without consuming CPU time"
            ),
        }
    }
}

impl core::error::Error for SimError {}

impl From<SpecError> for SimError {
    fn from(error: SpecError) -> Self {
        Self::Spec(error)
    }
}
