//! A server's side: goals that are offered, goals that are pursued, and what they share.
//!
//! ```text
//!   worker                                             any thread
//!   send_goal ──► NewGoal ─ accept ─► GoalHandle ─ execute, feedback, succeed, abort, canceled
//!       │            └─ reject, drop                        │
//!   cancel_goal ─► is_canceling()                           │ one lock: state, status array,
//!   get_result ──► answered at once, or when it ends ◄──────┘ answers to all who have asked
//!   timer ───────► results expire; what could not be sent is sent again
//! ```

use super::ids;
use super::state::{GoalEvent, GoalState};
use super::table::{Asked, NoPlace, Table, Ticket};
use crate::Nanos;
use crate::executor::{Responder, TimerHandle};
use crate::middleware::PublishError;
use crate::publisher::Publisher;
use crate::sync::{Arc, Mutex};
use alloc::string::String;
use core::fmt;
use core::time::Duration;
use replenish_msg::action::{
    Action, FeedbackMessage, GetResult, GetResultResponse, SendGoal, SendGoalResponse,
};
use replenish_msg::action_msgs::{CancelGoalRequest, CancelGoalResponse, GoalStatusArray};
use replenish_msg::unique_identifier_msgs::UUID;
use replenish_msg::{CdrWriter, Message};
use replenish_os::clock;

/// What could not be sent because there was no room is tried again after so many nanoseconds.
const RETRY: Nanos = 10_000_000;

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

/// What the goals of one server share.
pub(super) struct Core<A: Action> {
    state: Mutex<State<A>>,
    feedback: Publisher<FeedbackMessage<A>>,
    status: Publisher<GoalStatusArray>,
    timer: TimerHandle,
    pub(super) name: String,
}

struct State<A: Action> {
    table: Table<Responder<GetResult<A>>>,
    /// Reused for every publication.
    statuses: GoalStatusArray,
    /// The statuses have changed, and nobody was told.
    untold: bool,
    /// When the timer is due.
    armed: Nanos,
}

impl<A: Action> Core<A> {
    pub(super) fn new(
        name: String,
        (goals, askers, keep): (usize, usize, Nanos),
        feedback: Publisher<FeedbackMessage<A>>,
        status: Publisher<GoalStatusArray>,
        timer: TimerHandle,
    ) -> Arc<Self> {
        let size = GetResultResponse::<A>::MAX_SIZE;
        Arc::new(Self {
            state: Mutex::new(State {
                table: Table::new(goals, askers, size, keep),
                statuses: GoalStatusArray::default(),
                untold: false,
                armed: Nanos::MAX,
            }),
            feedback,
            status,
            timer,
            name,
        })
    }

    /// A goal has come: it gets a place, or is rejected.
    pub(super) fn offer(
        core: &Arc<Self>,
        id: UUID,
        to: Responder<SendGoal<A>>,
    ) -> Result<NewGoal<A>, GoalError> {
        let ticket = core.state.lock().table.offer(id);
        match ticket {
            Ok(ticket) => Ok(NewGoal {
                open: Some((Arc::clone(core), to)),
                ticket,
                id,
            }),
            Err(why) => {
                let no = SendGoalResponse::new(false, ids::now());
                to.reply(&no).map_err(GoalError::Send)?;
                Err(match why {
                    NoPlace::Full { limit } => GoalError::TooMany { limit },
                    NoPlace::Known => GoalError::Known,
                })
            }
        }
    }

    /// Somebody asks for a result.
    pub(super) fn ask(&self, id: UUID, asker: Responder<GetResult<A>>) -> Result<(), GoalError> {
        let mut state = self.state.lock();
        let told = match state.table.ask(id, asker) {
            Asked::Waits => return Ok(()),
            Asked::TooMany { limit } => return Err(GoalError::TooManyAskers { limit }),
            Asked::Unknown(asker) => {
                let unknown = GetResultResponse::default();
                return asker.reply(&unknown).map_err(GoalError::Send);
            }
            Asked::Ended(answer, asker) => asker.reply_bytes(answer).map_err(|e| (e, asker)),
        };
        match told {
            Ok(()) => state.table.got(id),
            Err((e, asker)) => {
                let later = e == PublishError::Full && state.table.postpone(id, asker);
                if !later {
                    return Err(GoalError::Send(e));
                }
            }
        }
        self.arm(&mut state);
        Ok(())
    }

    /// Cancels what `request` says, as far as the server is willing.
    pub(super) fn cancel(
        &self,
        request: &CancelGoalRequest,
        answer: &mut CancelGoalResponse,
        mut willing: impl FnMut(UUID) -> bool,
    ) {
        // The user is asked without the lock: the answer may come from looking at goals.
        let mut agreed = self.state.lock().table.cancelable(request);
        agreed.retain(|id| willing(*id));
        let mut state = self.state.lock();
        state.table.cancel(request, &agreed, answer);
        if !answer.goals_canceling.is_empty() {
            self.tell(&mut state);
        }
    }

    /// The timer: results expire, and what was not sent is sent again.
    pub(super) fn look_after(&self) -> Result<(), GoalError> {
        let mut state = self.state.lock();
        state.armed = Nanos::MAX;
        let expired = state.table.expire(clock::monotonic());
        let delivered = state.table.deliver(hand_over);
        if expired > 0 || state.untold {
            self.tell(&mut state);
        }
        self.arm(&mut state);
        delivered.map_err(GoalError::Send)
    }

    /// Publishes the states of all goals; later, if that does not work now.
    fn tell(&self, state: &mut State<A>) {
        let State {
            table, statuses, ..
        } = state;
        statuses.status_list.clear();
        statuses.status_list.extend(table.statuses());
        state.untold = self.status.publish(&state.statuses).is_err();
        if state.untold {
            self.arm(state);
        }
    }

    /// Sees to it that the timer is due when there is something to do.
    fn arm(&self, state: &mut State<A>) {
        let now = clock::monotonic();
        let retry = state.untold || state.table.has_undelivered();
        let retry = retry.then(|| now.saturating_add(RETRY));
        let next = [retry, state.table.next_expiry()];
        let Some(next) = next.into_iter().flatten().min() else {
            return;
        };
        if next < state.armed {
            state.armed = next;
            let wait = next.saturating_sub(now).max(1);
            self.timer.set_period(Duration::from_nanos(wait)).ok();
            self.timer.start();
        }
    }

    fn change(&self, ticket: Ticket, event: GoalEvent) -> Result<GoalState, GoalError> {
        let mut state = self.state.lock();
        let changed = state.table.change(ticket, event);
        let changed = changed.map_err(|state| refusal(event, state))?;
        self.tell(&mut state);
        Ok(changed)
    }

    fn end(&self, ticket: Ticket, event: GoalEvent, result: &A::Result) -> Result<(), GoalError> {
        let mut state = self.state.lock();
        let encode = |end: GoalState, room: &mut [u8]| {
            let mut w = CdrWriter::new(room);
            w.i8(end.status())?;
            result.encode(&mut w)?;
            Ok(w.len())
        };
        let ended = state.table.end(ticket, event, clock::monotonic(), encode);
        ended
            .map_err(|state| refusal(event, state))?
            .map_err(|e| GoalError::Send(PublishError::Encode(e)))?;
        self.tell(&mut state);
        let delivered = state.table.deliver(hand_over);
        self.arm(&mut state);
        delivered.map_err(GoalError::Send)
    }

    fn publish(&self, goal: &GoalHandle<A>, feedback: &A::Feedback) -> Result<(), GoalError> {
        let state = self.state.lock().table.state(goal.ticket);
        match state {
            None => return Err(GoalError::Expired),
            Some(state) if state.is_terminal() => return Err(GoalError::Ended { state }),
            Some(_) => {}
        }
        let sent = self.feedback.publish_with(|room| {
            let mut w = CdrWriter::new(room);
            goal.id.encode(&mut w)?;
            feedback.encode(&mut w)?;
            Ok(w.len())
        });
        sent.map_err(GoalError::Send)
    }
}

fn refusal(event: GoalEvent, state: Option<GoalState>) -> GoalError {
    match state {
        Some(state) => GoalError::State { event, state },
        None => GoalError::Expired,
    }
}

/// Sends a result to one who waits for it; whether it need not be tried again.
fn hand_over<A: Action>(
    asker: &Responder<GetResult<A>>,
    answer: &[u8],
) -> Result<bool, PublishError> {
    match asker.reply_bytes(answer) {
        Ok(()) => Ok(true),
        Err(PublishError::Full) => Ok(false),
        Err(e) => Err(e),
    }
}

/// A goal's server, and who waits for its answer.
type Open<A> = (Arc<Core<A>>, Responder<SendGoal<A>>);

/// A goal that somebody wants to be pursued: accept it, in the callback or later, from any thread.
///
/// Dropping it rejects the goal.
#[must_use = "dropping it rejects the goal"]
pub struct NewGoal<A: Action> {
    open: Option<Open<A>>,
    ticket: Ticket,
    id: GoalId,
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
    ticket: Ticket,
    id: GoalId,
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
