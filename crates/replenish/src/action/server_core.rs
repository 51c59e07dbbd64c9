//! The state that a server and its goals share, behind one lock.

use super::goal_error::GoalError;
use super::table::Table;
use crate::Nanos;
use crate::executor::TimerHandle;
use crate::publisher::Publisher;
use crate::service::responder::Responder;
use crate::sync::Mutex;
use alloc::string::String;
use replenish_msg::action::{Action, FeedbackMessage, GetResult};
use replenish_msg::action_msgs::GoalStatusArray;

/// The state that the goals of one server share.
pub(super) struct Core<A: Action> {
    pub(super) state: Mutex<CoreState<A>>,
    pub(super) feedback: Publisher<FeedbackMessage<A>>,
    pub(super) status: Publisher<GoalStatusArray>,
    pub(super) timer: TimerHandle,
    pub(super) name: String,
}

pub(super) struct CoreState<A: Action> {
    pub(super) table: Table<Responder<GetResult<A>>>,
    /// Reused for every publication.
    pub(super) statuses: GoalStatusArray,
    /// The statuses have changed and were not published yet.
    pub(super) untold: bool,
    /// The error of a goal's future, for the timer to report.
    pub(super) failed: Option<GoalError>,
    /// Time at which the timer is due.
    pub(super) armed: Nanos,
}
