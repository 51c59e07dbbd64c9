//! The states of a goal, as the ROS 2 design has them. Pure.
//!
//! ```text
//!                      execute                succeed
//!   ┌──────────┐    ┌───────────┐          ┌───────────┐
//!   │ ACCEPTED ├───►│ EXECUTING ├─────────►│ SUCCEEDED │◄─┐
//!   └────┬─────┘    └─┬───────┬─┘          └───────────┘  │
//!        │ cancel     │cancel │ abort      ┌───────────┐  │
//!        │     ┌──────┘       └───────────►│  ABORTED  │◄─┤
//!        ▼     ▼                           └───────────┘  │
//!   ┌───────────┐      succeed, abort                     │
//!   │ CANCELING ├─────────────────────────────────────────┘
//!   └────┬──────┘      canceled            ┌───────────┐
//!        └────────────────────────────────►│ CANCELED  │
//!                                          └───────────┘
//! ```
//!
//! A goal that was accepted and never executed can be given up (`abort`) as well: its handle may be
//! dropped, and its clients wait for a result.

use core::fmt;
use replenish_msg::action_msgs::GoalStatus;

/// State of a goal. The numbers are those of `action_msgs/msg/GoalStatus`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(i8)]
pub enum GoalState {
    /// The goal was accepted, and its execution has not begun.
    Accepted = GoalStatus::STATUS_ACCEPTED,
    /// The goal is worked on.
    Executing = GoalStatus::STATUS_EXECUTING,
    /// The goal shall end early and has not ended yet.
    Canceling = GoalStatus::STATUS_CANCELING,
    /// The goal was reached.
    Succeeded = GoalStatus::STATUS_SUCCEEDED,
    /// The goal ended early because a client cancelled it.
    Canceled = GoalStatus::STATUS_CANCELED,
    /// The goal ended early because it could not be reached.
    Aborted = GoalStatus::STATUS_ABORTED,
}

/// The events of a goal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum GoalEvent {
    /// The goal's execution begins.
    Execute,
    /// The goal shall end early.
    Cancel,
    /// The goal has been reached.
    Succeed,
    /// The goal has ended early, as a client asked.
    Canceled,
    /// The goal cannot be reached.
    Abort,
}

impl GoalState {
    /// All states.
    pub const ALL: [Self; 6] = [
        Self::Accepted,
        Self::Executing,
        Self::Canceling,
        Self::Succeeded,
        Self::Canceled,
        Self::Aborted,
    ];

    /// The state of this number; `None` for `STATUS_UNKNOWN` and what is no state at all.
    #[must_use]
    pub fn from_status(status: i8) -> Option<Self> {
        Self::ALL.into_iter().find(|s| s.status() == status)
    }

    /// The state's number in `action_msgs/msg/GoalStatus`.
    #[must_use]
    pub const fn status(self) -> i8 {
        self as i8
    }

    /// Whether nothing happens to the goal any more.
    #[must_use]
    pub const fn is_terminal(self) -> bool {
        matches!(self, Self::Succeeded | Self::Canceled | Self::Aborted)
    }

    /// The state after `event`; `None` if that cannot happen here.
    #[must_use]
    pub const fn after(self, event: GoalEvent) -> Option<Self> {
        use GoalEvent::{Abort, Cancel, Execute, Succeed};
        match (self, event) {
            (Self::Accepted, Execute) => Some(Self::Executing),
            (Self::Accepted | Self::Executing, Cancel) => Some(Self::Canceling),
            (Self::Executing | Self::Canceling, Succeed) => Some(Self::Succeeded),
            (Self::Canceling, GoalEvent::Canceled) => Some(Self::Canceled),
            (Self::Accepted | Self::Executing | Self::Canceling, Abort) => Some(Self::Aborted),
            _ => None,
        }
    }
}

impl fmt::Display for GoalState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Accepted => "accepted",
            Self::Executing => "executing",
            Self::Canceling => "canceling",
            Self::Succeeded => "succeeded",
            Self::Canceled => "canceled",
            Self::Aborted => "aborted",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::GoalEvent::{Abort, Cancel, Canceled, Execute, Succeed};
    use super::*;

    const EVENTS: [GoalEvent; 5] = [Execute, Cancel, Succeed, Canceled, Abort];

    #[test]
    fn exactly_the_transitions_of_the_design_exist() {
        use GoalState as S;
        let allowed = [
            (S::Accepted, Execute, S::Executing),
            (S::Accepted, Cancel, S::Canceling),
            (S::Accepted, Abort, S::Aborted),
            (S::Executing, Cancel, S::Canceling),
            (S::Executing, Succeed, S::Succeeded),
            (S::Executing, Abort, S::Aborted),
            (S::Canceling, Succeed, S::Succeeded),
            (S::Canceling, Canceled, S::Canceled),
            (S::Canceling, Abort, S::Aborted),
        ];
        for state in S::ALL {
            for event in EVENTS {
                let here = allowed.iter().find(|(s, e, _)| (*s, *e) == (state, event));
                let next = here.map(|(_, _, next)| *next);
                assert_eq!(state.after(event), next, "{state:?} {event:?}");
            }
        }
    }

    #[test]
    fn every_state_can_end_and_what_has_ended_stays_ended() {
        for state in GoalState::ALL {
            let nexts: Vec<_> = EVENTS.into_iter().filter_map(|e| state.after(e)).collect();
            assert_eq!(nexts.is_empty(), state.is_terminal(), "{state}");
            assert!(
                nexts.iter().all(|next| next > &state),
                "{state}: no way back"
            );
            assert_eq!(GoalState::from_status(state.status()), Some(state));
        }
        assert_eq!(GoalState::from_status(0), None);
        assert_eq!(GoalState::from_status(7), None);
    }
}
