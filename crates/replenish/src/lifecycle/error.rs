//! Reasons why a transition was not made.

use super::machine::{self, State};
use core::fmt;

/// A transition that was not made, or not to its goal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LifecycleError {
    /// There is no such transition from this state.
    NotAllowed {
        /// The state.
        from: State,
    },
    /// The callback did not succeed; the node is in this state now.
    NotReached {
        /// The state.
        now: State,
    },
    /// A callback of a transition asked for another transition.
    Nested,
}

impl fmt::Display for LifecycleError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotAllowed { from } => {
                write!(f, "not allowed in state {}; allowed are:", from.label())?;
                let allowed = machine::from(*from).filter(|a| a.id < 10);
                allowed
                    .into_iter()
                    .try_for_each(|a| write!(f, " {}", a.label))
            }
            Self::NotReached { now } => {
                write!(
                    f,
                    "the callback did not succeed; the state is {}",
                    now.label()
                )
            }
            Self::Nested => f.write_str("asked for from a callback of a transition"),
        }
    }
}

impl core::error::Error for LifecycleError {}
