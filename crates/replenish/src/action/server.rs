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

use super::goal::{GoalId, NewGoal};
use super::goal_error::GoalError;
use super::server_core::{Core, CoreState};
use super::state::{GoalEvent, GoalState};
use super::table::{Asked, NoPlace, Table, Ticket};
use crate::Nanos;
use crate::executor::TimerHandle;
use crate::middleware::PublishError;
use crate::middleware::encoding::Encoding;
use crate::middleware::remedy::SIZE;
use crate::platform;
use crate::publisher::Publisher;
use crate::service::responder::Responder;
use crate::sync::{Arc, Mutex};
use alloc::string::String;
use core::time::Duration;
use replenish_msg::action::{
    Action, FeedbackMessage, GetResult, GetResultResponse, SendGoal, SendGoalResponse,
};
use replenish_msg::action_msgs::{CancelGoalRequest, CancelGoalResponse, GoalStatusArray};
use replenish_msg::{CdrWriter, Message};
use replenish_os::clock;

/// After this many nanoseconds the server tries again to send an answer that found no room.
const RETRY: Nanos = 10_000_000;

impl<A: Action> Core<A> {
    pub(super) fn new(
        name: String,
        (goals, askers, size): (usize, usize, usize),
        keep: Nanos,
        feedback: Publisher<FeedbackMessage<A>>,
        status: Publisher<GoalStatusArray>,
        timer: TimerHandle,
    ) -> Arc<Self> {
        Arc::new(Self {
            state: Mutex::new(CoreState {
                table: Table::new(goals, askers, size, keep),
                statuses: GoalStatusArray::default(),
                untold: false,
                failed: None,
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
        id: GoalId,
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
                let no = SendGoalResponse::new(false, platform::wall_time());
                to.reply(&no).map_err(GoalError::Send)?;
                Err(match why {
                    NoPlace::Full { limit } => GoalError::TooMany { limit },
                    NoPlace::Known => GoalError::Known,
                })
            }
        }
    }

    /// Answers a request for a result, now or when the goal ends.
    pub(super) fn ask(&self, id: GoalId, asker: Responder<GetResult<A>>) -> Result<(), GoalError> {
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
        mut willing: impl FnMut(GoalId) -> bool,
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
        let failed = state.failed.take().map_or(Ok(()), Err);
        delivered.map_err(GoalError::Send).and(failed)
    }

    /// A goal's future has ended with an error that has no callback to return from: the timer
    /// reports it.
    pub(super) fn fail(&self, why: GoalError) {
        let mut state = self.state.lock();
        state.failed = Some(why);
        self.arm(&mut state);
    }

    /// Publishes the states of all goals; later, if that does not work now.
    pub(super) fn tell(&self, state: &mut CoreState<A>) {
        let CoreState {
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
    fn arm(&self, state: &mut CoreState<A>) {
        let now = clock::monotonic();
        let retry = state.untold || state.failed.is_some() || state.table.has_undelivered();
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

    pub(super) fn change(&self, ticket: Ticket, event: GoalEvent) -> Result<GoalState, GoalError> {
        let mut state = self.state.lock();
        let changed = state.table.change(ticket, event);
        let changed = changed.map_err(|state| refusal(event, state))?;
        self.tell(&mut state);
        Ok(changed)
    }

    pub(super) fn end(
        &self,
        ticket: Ticket,
        event: GoalEvent,
        result: &A::Result,
    ) -> Result<(), GoalError> {
        let mut state = self.state.lock();
        let encode = |end: GoalState, room: &mut [u8]| {
            let mut w = CdrWriter::new(room);
            let encoded = w.i8(end.status()).and_then(|()| result.encode(&mut w));
            let len = w.len();
            let encoding = Encoding::of::<GetResultResponse<A>>(SIZE);
            encoded.map_err(|e| encoding.failed(e, room)).map(|()| len)
        };
        let ended = state.table.end(ticket, event, clock::monotonic(), encode);
        ended
            .map_err(|state| refusal(event, state))?
            .map_err(GoalError::Send)?;
        self.tell(&mut state);
        let delivered = state.table.deliver(hand_over);
        self.arm(&mut state);
        delivered.map_err(GoalError::Send)
    }

    pub(super) fn publish(
        &self,
        ticket: Ticket,
        id: GoalId,
        feedback: &A::Feedback,
    ) -> Result<(), GoalError> {
        let state = self.state.lock().table.state(ticket);
        match state {
            None => return Err(GoalError::Expired),
            Some(state) if state.is_terminal() => return Err(GoalError::Ended { state }),
            Some(_) => {}
        }
        let sent = self.feedback.publish_with(|room| {
            let mut w = CdrWriter::new(room);
            id.encode(&mut w)?;
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

/// Sends a result to a client that waits for it; whether it need not be tried again.
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
