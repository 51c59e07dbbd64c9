//! Goals whose ends are awaited.

use super::client::{ActionClient, Lost, encode};
use super::goal::GoalId;
use super::state::GoalState;
use crate::error::Error;
use crate::executor::{AddHandles, Target};
use crate::service::call::Call;
use crate::service::error::{CallError, NoReply};
use core::fmt;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll};
use replenish_msg::action::{Action, GetResult, GetResultRequest, SendGoal};
use replenish_msg::action_msgs::{CancelGoal, CancelGoalRequest, GoalInfo};

/// A goal that was sent: awaited, it gives the goal as its server accepted it.
#[must_use = "the goal is sent; the server's answer is here"]
pub struct GoalCall<A: Action> {
    call: Call<SendGoal<A>>,
    id: GoalId,
    client: ActionClient<A>,
}

/// A goal that its server pursues. Dropping it cancels nothing.
pub struct AcceptedGoal<A: Action> {
    id: GoalId,
    client: ActionClient<A>,
}

/// A result that was asked for: awaited, it gives how the goal ended, and its result.
#[must_use = "the result is asked for; it is here"]
pub struct ResultCall<A: Action>(Call<GetResult<A>>);

fn lost(error: CallError, of: fn(NoReply) -> Lost) -> Lost {
    match error {
        CallError::NoReply(why) => of(why),
        other => Lost::Ask(other),
    }
}

impl<A: Action> Future for GoalCall<A> {
    /// `None`: the server has rejected the goal.
    type Output = Result<Option<AcceptedGoal<A>>, Lost>;

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        Pin::new(&mut self.call).poll(cx).map(|answer| {
            let accepted = answer.map_err(|e| lost(e, Lost::Goal))?.accepted;
            Ok(accepted.then(|| AcceptedGoal {
                id: self.id,
                client: self.client.clone(),
            }))
        })
    }
}

impl<A: Action> Future for ResultCall<A> {
    type Output = Result<(GoalState, A::Result), Lost>;

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        Pin::new(&mut self.0).poll(cx).map(|answer| {
            let answer = answer.map_err(|e| lost(e, Lost::Result))?;
            let state = GoalState::from_status(answer.status).ok_or(Lost::Unknown)?;
            Ok((state, answer.result))
        })
    }
}

impl<A: Action> AcceptedGoal<A> {
    /// The goal's id.
    #[must_use]
    pub const fn id(&self) -> GoalId {
        self.id
    }

    /// Asks for the goal's result, which comes when the goal has ended: `goal.result().await`.
    /// [`Lost`] if it does not come within [`result_within`](crate::ActionOptions::result_within).
    ///
    /// Dropping the future makes room at the client. The server keeps the question until the goal
    /// ends, and a goal has room for a few only (at a server of this crate
    /// [`askers`](crate::ActionOptions::askers)): to wait in turns, poll one future again.
    pub fn result(&self) -> ResultCall<A> {
        let request = GetResultRequest::new(self.id);
        ResultCall(self.client.inner.result.call_async(&request))
    }

    /// Asks the server to cancel the goal; the future gives its answer.
    pub fn cancel(&self) -> Call<CancelGoal> {
        let goal_info = GoalInfo {
            goal_id: self.id,
            ..GoalInfo::default()
        };
        let cancel = &self.client.inner.cancel;
        cancel.call_async(&CancelGoalRequest { goal_info })
    }
}

impl<A: Action> ActionClient<A> {
    /// Sends a goal, whose end is then awaited:
    ///
    /// ```text
    /// if let Some(goal) = client.send_async(&goal).await? {
    ///     let (state, result) = goal.result().await?;
    /// }
    /// ```
    ///
    /// The client belongs to a worker: [`WorkerBuilder::goals`](crate::WorkerBuilder::goals). Does
    /// not allocate. Feedback is not heard; [`follow`](crate::WorkerBuilder::follow) hears it.
    pub fn send_async(&self, goal: &A::Goal) -> GoalCall<A> {
        let id = self.inner.ids.next();
        GoalCall {
            call: self
                .inner
                .send
                .call_async_with(|room| encode(id, goal, room)),
            id,
            client: self.clone(),
        }
    }
}

impl<T: Target> AddHandles<T> {
    /// Takes the server's answers for [`ActionClient::send_async`] on this worker: three handles,
    /// in the place of [`follow`](Self::follow).
    ///
    /// # Errors
    /// As [`calls`](Self::calls).
    pub fn goals<A: Action>(self, client: &ActionClient<A>) -> Result<T::AllAdded, Error> {
        let parts = &client.inner;
        let all = self.together().calls(&parts.send)?.calls(&parts.cancel)?;
        Ok(all.last().calls(&parts.result)?.all_added(2))
    }
}

impl<A: Action> fmt::Debug for GoalCall<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "GoalCall({})", self.id)
    }
}

impl<A: Action> fmt::Debug for AcceptedGoal<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "AcceptedGoal({})", self.id)
    }
}

impl<A: Action> fmt::Debug for ResultCall<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("ResultCall").field(&self.0).finish()
    }
}
