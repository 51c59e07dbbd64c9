//! A client's side: goals that were sent, and what is heard of them.
//!
//! ```text
//!   send_goal: a place ── request ──► SENT ── accepted ──► ASKED ── result ──► place is free
//!                                       │                    │
//!                    rejected, no reply ┴────────────────────┴ no reply, forget ──► place is free
//! ```
//!
//! When the server accepts a goal, the client asks for its result; the server answers when the goal
//! ends.

use super::ActionOptions;
use super::goal::GoalId;
use super::ids::Ids;
use super::state::GoalState;
use crate::context::Node;
use crate::error::Error;
use crate::executor::CallbackResult;
use crate::service::client::Client;
use crate::service::error::{CallError, NoReply};
use crate::sync::{Arc, Mutex};
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use core::time::Duration;
use replenish_msg::action::{
    Action, FeedbackMessage, GetResult, GetResultRequest, GetResultResponse, SendGoal,
    SendGoalResponse,
};
use replenish_msg::action_msgs::{
    CancelGoal, CancelGoalRequest, CancelGoalResponse, GoalInfo, GoalStatusArray, MAX_GOALS,
};
use replenish_msg::builtin_interfaces::Time;
use replenish_msg::{CdrError, CdrWriter, Message, heapless};

/// Something was heard of a goal.
#[non_exhaustive]
pub enum GoalUpdate<'a, A: Action> {
    /// The server pursues it, since this time by its wall clock; zeros where feedback arrived
    /// before the server's answer.
    Accepted(Time),
    /// The server does not pursue it. Nothing more will be heard of it.
    Rejected,
    /// Progress of the goal.
    Feedback(&'a A::Feedback),
    /// The goal is in this state now.
    State(GoalState),
    /// The goal has ended in this state and with this result. It is the last update of the goal.
    Result(GoalState, &'a A::Result),
    /// The server's answer to a request to cancel: one of the constants of
    /// [`CancelGoalResponse`], and the goals that are being canceled, other clients' included. The
    /// goal's id is that of the request, zeros if it was not about one goal.
    Cancel(&'a CancelGoalResponse),
    /// The server does not answer, or its answer makes no sense. The goal's fate is not known, and
    /// there are no further updates of it.
    Lost(Lost),
}

/// Reason why nothing more is heard of a goal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Lost {
    /// The server has not said in time whether it accepts the goal.
    Goal(NoReply),
    /// The server has not sent the result in time.
    Result(NoReply),
    /// The result could not be asked for.
    Ask(CallError),
    /// The server knows nothing of the goal any more: it was started anew, or the result expired.
    Unknown,
    /// The server has not answered a request to cancel in time. Of the goal itself more may be
    /// heard.
    Cancel(NoReply),
}

impl fmt::Display for Lost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Goal(e) => write!(f, "goal: {e}"),
            Self::Result(e) => write!(f, "result: {e}"),
            Self::Ask(e) => write!(f, "result: {e}"),
            Self::Unknown => f.write_str("the server does not know the goal"),
            Self::Cancel(e) => write!(f, "cancel: {e}"),
        }
    }
}

impl core::error::Error for Lost {}

impl<A: Action> fmt::Debug for GoalUpdate<'_, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Accepted(at) => write!(f, "Accepted({}.{:09})", at.sec, at.nanosec),
            Self::Rejected => f.write_str("Rejected"),
            Self::Feedback(_) => f.write_str("Feedback(..)"),
            Self::State(state) => write!(f, "State({state})"),
            Self::Result(state, _) => write!(f, "Result({state}, ..)"),
            Self::Cancel(answer) => write!(f, "Cancel({})", answer.return_code),
            Self::Lost(why) => write!(f, "Lost({why})"),
        }
    }
}

/// Sends goals of one action. Clones are the same client; any thread may use them.
///
/// News of the goals comes to the callback of
/// [`WorkerBuilder::follow`](crate::WorkerBuilder::follow).
pub struct ActionClient<A: Action> {
    pub(super) inner: Arc<Inner<A>>,
}

pub(super) struct Inner<A: Action> {
    pub(super) send: Client<SendGoal<A>>,
    pub(super) cancel: Client<CancelGoal>,
    pub(super) result: Client<GetResult<A>>,
    pub(super) node: Node,
    pub(super) name: String,
    pub(super) options: ActionOptions,
    pub(super) ids: Ids,
    goals: Mutex<Goals>,
}

struct Goals {
    sent: Vec<Sent>,
    /// Requests to cancel: their numbers, and which goal they are about.
    cancels: Vec<(u64, GoalId)>,
    limit: usize,
}

struct Sent {
    id: GoalId,
    /// The number of the request that waits for its reply.
    number: u64,
    asked: bool,
    /// The state that the server reported last.
    state: Option<GoalState>,
}

impl<A: Action> ActionClient<A> {
    pub(super) fn new(
        node: Node,
        name: String,
        (send, cancel, result): (
            Client<SendGoal<A>>,
            Client<CancelGoal>,
            Client<GetResult<A>>,
        ),
        options: ActionOptions,
    ) -> Self {
        let limit = options.goals;
        let goals = Goals {
            sent: Vec::with_capacity(limit),
            cancels: Vec::with_capacity(limit),
            limit,
        };
        Self {
            inner: Arc::new(Inner {
                send,
                cancel,
                result,
                node,
                name,
                options,
                ids: Ids::new(),
                goals: Mutex::new(goals),
            }),
        }
    }

    /// Sends a goal and returns its id. Does not allocate and never waits.
    ///
    /// # Errors
    /// [`CallError::TooMany`] with the limit of
    /// [`ActionOptions::goals`](super::ActionOptions::goals) while so many goals have not ended;
    /// [`CallError::NoCallback`] before [`WorkerBuilder::follow`](crate::WorkerBuilder::follow);
    /// [`CallError::Gone`] after its executor; [`CallError::Send`].
    pub fn send(&self, goal: &A::Goal) -> Result<GoalId, CallError> {
        let inner = &self.inner;
        let id = inner.ids.next();
        // Held while it is sent: nothing must be heard of the goal before it is in the table.
        let mut goals = inner.goals.lock();
        let limit = goals.limit;
        if goals.sent.len() >= limit && !inner.send.is_gone() {
            return Err(CallError::TooMany { limit });
        }
        let sent = inner.send.call_with(|room| encode(id, goal, room));
        let number = sent?;
        goals.sent.push(Sent {
            id,
            number,
            asked: false,
            state: None,
        });
        Ok(id)
    }

    /// Asks the server to cancel one goal.
    ///
    /// # Errors
    /// As [`send`](Self::send), with as many requests to cancel at a time as goals.
    pub fn cancel(&self, goal: GoalId) -> Result<(), CallError> {
        self.request_cancel(goal, Time::default())
    }

    /// Asks the server to cancel all goals, those of other clients included.
    ///
    /// # Errors
    /// As [`cancel`](Self::cancel).
    pub fn cancel_all(&self) -> Result<(), CallError> {
        self.request_cancel(GoalId::default(), Time::default())
    }

    /// Asks the server to cancel the goals it has accepted at `stamp` by its wall clock or before,
    /// those of other clients included. (Zeros mean all goals.)
    ///
    /// # Errors
    /// As [`cancel`](Self::cancel).
    pub fn cancel_until(&self, stamp: Time) -> Result<(), CallError> {
        self.request_cancel(GoalId::default(), stamp)
    }

    fn request_cancel(&self, goal_id: GoalId, stamp: Time) -> Result<(), CallError> {
        let goal_info = GoalInfo { goal_id, stamp };
        let mut goals = self.inner.goals.lock();
        let limit = goals.limit;
        if goals.cancels.len() >= limit && !self.inner.cancel.is_gone() {
            return Err(CallError::TooMany { limit });
        }
        let number = self.inner.cancel.call(&CancelGoalRequest { goal_info })?;
        goals.cancels.push((number, goal_id));
        Ok(())
    }

    /// Wants to hear no more of a goal: its place is free. The server goes on with it. `false` if
    /// nothing would have been heard anyway.
    #[must_use]
    pub fn forget(&self, goal: GoalId) -> bool {
        let mut goals = self.inner.goals.lock();
        let Some(at) = goals.sent.iter().position(|s| s.id == goal) else {
            return false;
        };
        let sent = goals.sent.swap_remove(at);
        // A result may take for ever, and its request would keep its place as long.
        if sent.asked {
            self.inner.result.give_up(sent.number);
        } else {
            self.inner.send.give_up(sent.number);
        }
        true
    }

    /// Number of this client's goals that have not ended.
    #[must_use]
    pub fn under_way(&self) -> usize {
        self.inner.goals.lock().sent.len()
    }

    /// Waits for at most `limit` until the action has a server. For set-up; see
    /// [`Client::wait_for_server`].
    ///
    /// # Errors
    /// [`Error::Middleware`] where the middleware does not know (DDS-XRCE).
    pub fn wait_for_server(&self, limit: Duration) -> Result<bool, Error> {
        self.inner.send.wait_for_server(limit)
    }

    /// The action's fully qualified name.
    #[must_use]
    pub fn action(&self) -> &str {
        &self.inner.name
    }
}

impl<A: Action> Clone for ActionClient<A> {
    fn clone(&self) -> Self {
        let inner = Arc::clone(&self.inner);
        Self { inner }
    }
}

impl<A: Action> fmt::Debug for ActionClient<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ActionClient")
            .field("action", &self.inner.name)
            .finish_non_exhaustive()
    }
}

/// Writes the request that sends a goal.
pub(super) fn encode(id: GoalId, goal: &impl Message, room: &mut [u8]) -> Result<usize, CdrError> {
    let mut w = CdrWriter::new(room);
    id.encode(&mut w)?;
    goal.encode(&mut w)?;
    Ok(w.len())
}

/// Handles the server's answers on the worker; `tell` is the user's callback.
impl<A: Action> Inner<A> {
    /// The answer to request `number`: a goal is accepted or not.
    pub(super) fn answered<R>(
        &self,
        number: u64,
        answer: Result<&SendGoalResponse<A>, NoReply>,
        tell: impl FnOnce(GoalId, GoalUpdate<'_, A>) -> Option<R>,
    ) -> Option<R> {
        let (id, update) = {
            let mut goals = self.goals.lock();
            let mut all = goals.sent.iter();
            let at = all.position(|s| !s.asked && s.number == number)?;
            let sent = goals.sent.get_mut(at)?;
            let id = sent.id;
            let update = match answer {
                Ok(answer) if answer.accepted => {
                    match self.result.call(&GetResultRequest::new(id)) {
                        Ok(number) => {
                            (sent.number, sent.asked) = (number, true);
                            GoalUpdate::Accepted(answer.stamp)
                        }
                        Err(e) => GoalUpdate::Lost(Lost::Ask(e)),
                    }
                }
                Ok(_) => GoalUpdate::Rejected,
                Err(e) => GoalUpdate::Lost(Lost::Goal(e)),
            };
            if !matches!(update, GoalUpdate::Accepted(_)) {
                goals.sent.swap_remove(at);
            }
            (id, update)
        };
        tell(id, update)
    }

    /// The answer to request `number`: a result.
    pub(super) fn ended<R>(
        &self,
        number: u64,
        answer: Result<&GetResultResponse<A>, NoReply>,
        tell: impl FnOnce(GoalId, GoalUpdate<'_, A>) -> Option<R>,
    ) -> Option<R> {
        let id = {
            let mut goals = self.goals.lock();
            let mut all = goals.sent.iter();
            let at = all.position(|s| s.asked && s.number == number)?;
            goals.sent.swap_remove(at).id
        };
        let update = match answer {
            Ok(answer) => match GoalState::from_status(answer.status) {
                Some(state) => GoalUpdate::Result(state, &answer.result),
                None => GoalUpdate::Lost(Lost::Unknown),
            },
            Err(e) => GoalUpdate::Lost(Lost::Result(e)),
        };
        tell(id, update)
    }

    /// The answer to request `number` to cancel.
    pub(super) fn canceled<R>(
        &self,
        number: u64,
        answer: Result<&CancelGoalResponse, NoReply>,
        tell: impl FnOnce(GoalId, GoalUpdate<'_, A>) -> Option<R>,
    ) -> Option<R> {
        let id = {
            let mut goals = self.goals.lock();
            let at = goals.cancels.iter().position(|(n, _)| *n == number)?;
            goals.cancels.swap_remove(at).1
        };
        let update = match answer {
            Ok(answer) => GoalUpdate::Cancel(answer),
            Err(e) => GoalUpdate::Lost(Lost::Cancel(e)),
        };
        tell(id, update)
    }

    /// Feedback for a goal, of this client or another. Feedback may overtake the answer that
    /// accepts the goal. It then stands for that answer: the acceptance is reported first.
    pub(super) fn heard<R>(
        &self,
        message: &FeedbackMessage<A>,
        mut tell: impl FnMut(GoalId, GoalUpdate<'_, A>) -> R,
    ) -> Several<R> {
        let id = message.goal_id;
        let mut results = heapless::Vec::new();
        let first = {
            let mut goals = self.goals.lock();
            let Some(at) = goals.sent.iter().position(|s| s.id == id) else {
                return Several(results);
            };
            match goals.sent.get_mut(at).filter(|sent| !sent.asked) {
                None => None,
                Some(sent) => match self.result.call(&GetResultRequest::new(id)) {
                    Ok(number) => {
                        (sent.number, sent.asked) = (number, true);
                        Some(GoalUpdate::Accepted(Time::default()))
                    }
                    Err(e) => {
                        goals.sent.swap_remove(at);
                        Some(GoalUpdate::Lost(Lost::Ask(e)))
                    }
                },
            }
        };
        let lost = matches!(first, Some(GoalUpdate::Lost(_)));
        if let Some(update) = first {
            results.push(tell(id, update)).ok();
        }
        if !lost {
            let update = GoalUpdate::Feedback(&message.feedback);
            results.push(tell(id, update)).ok();
        }
        Several(results)
    }

    /// The states of all goals of the server: tells those that have changed.
    pub(super) fn states<R>(
        &self,
        all: &GoalStatusArray,
        mut tell: impl FnMut(GoalId, GoalUpdate<'_, A>) -> R,
    ) -> Several<R> {
        let mut results = heapless::Vec::new();
        for status in &all.status_list {
            let id = status.goal_info.goal_id;
            let Some(state) = GoalState::from_status(status.status) else {
                continue;
            };
            let changed = {
                let mut goals = self.goals.lock();
                let sent = goals.sent.iter_mut().find(|s| s.id == id);
                // States only go forward; an older array may come late.
                let sent = sent.filter(|s| s.state.is_none_or(|before| before < state));
                sent.map(|s| s.state = Some(state)).is_some()
            };
            if changed {
                results.push(tell(id, GoalUpdate::State(state))).ok();
            }
        }
        Several(results)
    }
}

/// The results of a callback that was called for several goals.
pub(super) struct Several<R>(heapless::Vec<R, MAX_GOALS>);

impl<R: CallbackResult> CallbackResult for Several<R> {
    fn inspect(self, report: &mut dyn FnMut(&dyn fmt::Display)) {
        self.0.into_iter().for_each(|result| result.inspect(report));
    }
}
