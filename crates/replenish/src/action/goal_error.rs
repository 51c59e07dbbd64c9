//! The errors of a goal.

use super::state::{GoalEvent, GoalState};
use crate::middleware::PublishError;
use core::fmt;

/// Something could not be done to a goal, or a goal could not be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum GoalError {
    /// The goal's state does not allow it; nothing has changed.
    State {
        /// The event that was to happen.
        event: GoalEvent,
        /// The state the goal is in.
        state: GoalState,
    },
    /// The goal has ended, and no client wants to hear more of it.
    Ended {
        /// The state in which it ended.
        state: GoalState,
    },
    /// The goal has ended, and its result has expired.
    Expired,
    /// The server has the most goals that its options allow. It rejected this one.
    TooMany {
        /// The most goals that the server may have.
        limit: usize,
    },
    /// The server has a goal with this id already. It rejected the new one.
    Known,
    /// The most clients wait for the result of this goal already. This client gets no answer.
    TooManyAskers {
        /// The most clients that may wait for one result.
        limit: usize,
    },
    /// The goal has changed its state, but a message about it could not be sent to each client.
    Send(PublishError),
}

impl fmt::Display for GoalError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::State { event, state } => {
                write!(f, "{event:?} cannot happen to a goal that is {state}")
            }
            Self::Ended { state } => write!(f, "the goal has ended: it is {state}"),
            Self::Expired => f.write_str("the goal has ended and its result has expired"),
            Self::TooMany { limit } => write!(f, "goal rejected: too many, the limit is {limit}"),
            Self::Known => f.write_str("goal rejected: there is one with this id"),
            Self::TooManyAskers { limit } => {
                write!(
                    f,
                    "too many ask for the result of one goal: the limit is {limit}"
                )
            }
            Self::Send(e) => write!(f, "the goal's clients were not told: {e}"),
        }
    }
}

impl core::error::Error for GoalError {}
