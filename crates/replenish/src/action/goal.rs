//! What a server's callbacks get: a goal that is offered, then a goal that is pursued; and what can
//! go wrong with it.

use super::ids;
use super::server_core::Core;
use super::state::{GoalEvent, GoalState};
use super::table::Ticket;
use crate::executor::Responder;
use crate::middleware::PublishError;
use crate::sync::Arc;
use core::fmt;
use replenish_msg::action::{Action, SendGoal, SendGoalResponse};
use replenish_msg::unique_identifier_msgs::UUID;

/// Names a goal.
pub type GoalId = UUID;

/// Something could not be done to a goal, or a goal could not be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum GoalError {
    /// The goal's state does not allow it; nothing has changed.
    State {
        /// What was to happen.
        event: GoalEvent,
        /// The state the goal is in.
        state: GoalState,
    },
    /// It has ended, and nobody wants to hear more of it.
    Ended {
        /// How.
        state: GoalState,
    },
    /// It has ended, and its result has expired.
    Expired,
    /// So many goals are there already. It was rejected.
    TooMany {
        /// How many there may be.
        limit: usize,
    },
    /// A goal with this id is there already. It was rejected.
    Known,
    /// So many ask for the result of one goal already. This one gets no answer.
    TooManyAskers {
        /// How many may.
        limit: usize,
    },
    /// It happened, but could not be told to everybody.
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

/// A goal's server, and who waits for its answer.
type Open<A> = (Arc<Core<A>>, Responder<SendGoal<A>>);

/// A goal that somebody wants to be pursued: accept it, in the callback or later, from any thread.
///
/// Dropping it rejects the goal.
#[must_use = "dropping it rejects the goal"]
pub struct NewGoal<A: Action> {
    pub(super) open: Option<Open<A>>,
    pub(super) ticket: Ticket,
    pub(super) id: GoalId,
}

impl<A: Action> NewGoal<A> {
    /// The goal's id, which its client has chosen.
    #[must_use]
    pub fn id(&self) -> GoalId {
        self.id
    }

    /// Tells the client that the goal is pursued from now on: it is executing.
    ///
    /// # Errors
    /// [`GoalError::Send`] if the client could not be told; then the goal is not pursued.
    pub fn accept(self) -> Result<GoalHandle<A>, GoalError> {
        self.accept_as(GoalState::Executing)
    }

    /// Tells the client that the goal will be pursued: it is accepted, and
    /// [`GoalHandle::execute`] begins its execution.
    ///
    /// # Errors
    /// As [`accept`](Self::accept).
    pub fn accept_for_later(self) -> Result<GoalHandle<A>, GoalError> {
        self.accept_as(GoalState::Accepted)
    }

    fn accept_as(mut self, begin: GoalState) -> Result<GoalHandle<A>, GoalError> {
        let (ticket, id) = (self.ticket, self.id);
        let Some((core, to)) = self.open.take() else {
            return Err(GoalError::Expired); // it is open as long as it exists
        };
        let stamp = ids::now();
        let mut state = core.state.lock();
        if let Err(e) = to.reply(&SendGoalResponse::new(true, stamp)) {
            state.table.reject(ticket);
            return Err(GoalError::Send(e));
        }
        state.table.accept(ticket, stamp, begin);
        core.tell(&mut state);
        drop(state);
        Ok(GoalHandle { core, ticket, id })
    }

    /// Tells the client that the goal is not pursued.
    ///
    /// # Errors
    /// [`GoalError::Send`] if the client could not be told.
    pub fn reject(mut self) -> Result<(), GoalError> {
        self.decline()
    }

    fn decline(&mut self) -> Result<(), GoalError> {
        let Some((core, to)) = self.open.take() else {
            return Ok(());
        };
        core.state.lock().table.reject(self.ticket);
        let no = SendGoalResponse::new(false, ids::now());
        to.reply(&no).map_err(GoalError::Send)
    }
}

impl<A: Action> Drop for NewGoal<A> {
    fn drop(&mut self) {
        // A client that cannot be told runs into its time limit.
        self.decline().ok();
    }
}

impl<A: Action> fmt::Debug for NewGoal<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "NewGoal({})", self.id)
    }
}

/// A goal that is pursued. It may be moved to any thread, and all of its methods may be called from
/// any thread; none allocates or waits for a peer.
///
/// Dropping it before it has ended aborts the goal, with a result of default values.
#[must_use = "dropping it aborts the goal"]
pub struct GoalHandle<A: Action> {
    core: Arc<Core<A>>,
    pub(super) ticket: Ticket,
    pub(super) id: GoalId,
}

impl<A: Action> GoalHandle<A> {
    /// The goal's id.
    #[must_use]
    pub fn id(&self) -> GoalId {
        self.id
    }

    /// Where the goal is in its life; `None` when it has ended and its result has expired.
    #[must_use]
    pub fn state(&self) -> Option<GoalState> {
        self.core.state.lock().table.state(self.ticket)
    }

    /// Whether somebody wants the goal to end early: look now and then, and end it with
    /// [`canceled`](Self::canceled) when it is safe to.
    #[must_use]
    pub fn is_canceling(&self) -> bool {
        self.state() == Some(GoalState::Canceling)
    }

    /// Begins the execution of a goal that was accepted for later.
    ///
    /// # Errors
    /// [`GoalError::State`] if it executes already, is being canceled, or has ended.
    pub fn execute(&self) -> Result<(), GoalError> {
        self.core.change(self.ticket, GoalEvent::Execute).map(drop)
    }

    /// Publishes how far the goal has come.
    ///
    /// # Errors
    /// [`GoalError::Ended`], [`GoalError::Expired`]; [`GoalError::Send`].
    pub fn feedback(&self, feedback: &A::Feedback) -> Result<(), GoalError> {
        self.core.publish(self, feedback)
    }

    /// Ends the goal: it has been reached.
    ///
    /// # Errors
    /// [`GoalError::State`] if it does not execute; [`GoalError::Send`] if it has ended but
    /// somebody who waits for the result could not be told.
    pub fn succeed(&self, result: &A::Result) -> Result<(), GoalError> {
        self.core.end(self.ticket, GoalEvent::Succeed, result)
    }

    /// Ends the goal: it ended early because somebody wanted it to.
    ///
    /// # Errors
    /// As [`succeed`](Self::succeed); [`GoalError::State`] if nobody wanted it to.
    pub fn canceled(&self, result: &A::Result) -> Result<(), GoalError> {
        self.core.end(self.ticket, GoalEvent::Canceled, result)
    }

    /// Ends the goal: it cannot be reached.
    ///
    /// # Errors
    /// As [`succeed`](Self::succeed); [`GoalError::State`] if it has ended already.
    pub fn abort(&self, result: &A::Result) -> Result<(), GoalError> {
        self.core.end(self.ticket, GoalEvent::Abort, result)
    }
}

impl<A: Action> Drop for GoalHandle<A> {
    fn drop(&mut self) {
        if self.state().is_some_and(|state| !state.is_terminal()) {
            // What was not sent is sent again; nobody is left to tell anything else to.
            self.abort(&A::Result::default()).ok();
        }
    }
}

impl<A: Action> fmt::Debug for GoalHandle<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GoalHandle")
            .field("id", &self.id)
            .field("state", &self.state())
            .finish_non_exhaustive()
    }
}
