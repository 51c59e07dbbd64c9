//! The arguments of a server's callbacks: a goal that is offered, then a goal that is pursued.

use super::goal_error::GoalError;
use super::server_core::Core;
use super::state::{GoalEvent, GoalState};
use super::table::Ticket;
use crate::platform;
use crate::service::responder::Responder;
use crate::sync::Arc;
use core::fmt;
use replenish_msg::action::{Action, SendGoal, SendGoalResponse};
use replenish_msg::unique_identifier_msgs::UUID;

/// Names a goal.
pub type GoalId = UUID;

/// A goal's server, and the client that waits for its answer.
type Open<A> = (Arc<Core<A>>, Responder<SendGoal<A>>);

/// A goal that a client asks for: accept it, in the callback or later, from any thread.
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
    /// [`GoalError::Send`] if the answer could not be sent; then the goal is not pursued.
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
        let stamp = platform::wall_time();
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
    /// [`GoalError::Send`] if the answer could not be sent.
    pub fn reject(mut self) -> Result<(), GoalError> {
        self.decline()
    }

    fn decline(&mut self) -> Result<(), GoalError> {
        let Some((core, to)) = self.open.take() else {
            return Ok(());
        };
        core.state.lock().table.reject(self.ticket);
        let no = SendGoalResponse::new(false, platform::wall_time());
        to.reply(&no).map_err(GoalError::Send)
    }
}

impl<A: Action> Drop for NewGoal<A> {
    fn drop(&mut self) {
        // A client that gets no answer runs into its time limit.
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

    /// State of the goal; `None` when it has ended and its result has expired.
    #[must_use]
    pub fn state(&self) -> Option<GoalState> {
        self.core.state.lock().table.state(self.ticket)
    }

    /// Whether a client has asked to cancel the goal. Check it now and then, and end the goal with
    /// [`canceled`](Self::canceled) as soon as that is safe.
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
        self.core.publish(self.ticket, self.id, feedback)
    }

    /// Ends the goal: it has been reached.
    ///
    /// # Errors
    /// [`GoalError::State`] if it does not execute; [`GoalError::Send`] if it has ended but the
    /// result could not be sent to a client that waits for it.
    pub fn succeed(&self, result: &A::Result) -> Result<(), GoalError> {
        self.core.end(self.ticket, GoalEvent::Succeed, result)
    }

    /// Ends the goal: it ended early because a client cancelled it.
    ///
    /// # Errors
    /// As [`succeed`](Self::succeed); [`GoalError::State`] if no client has cancelled it.
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
            // The server repeats an answer that was not sent; other errors have no receiver left.
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
