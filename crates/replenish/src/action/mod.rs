//! Actions: goals that take their time, can be canceled, and tell how far they have come.
//!
//! An action is what ROS 2 makes of three services and two topics. Here each is a handle of one
//! worker, so that everything about it runs under that worker's policy and budget:
//!
//! ```text
//!   client                                                      server
//!   ActionClient::send ─────── <name>/_action/send_goal ──────► goal callback: accept or not
//!   (when it is accepted) ──── <name>/_action/get_result ─────► answered when the goal ends
//!   ActionClient::cancel… ──── <name>/_action/cancel_goal ────► cancel callback: willing or not
//!   GoalUpdate::Feedback ◄──── <name>/_action/feedback ──────── GoalHandle::feedback
//!   GoalUpdate::State ◄─────── <name>/_action/status ────────── at every change of any goal
//! ```
//!
//! - [`state`]: a goal's states. [`table`]: the goals of a server. Both pure.
//! - [`goal`]: goals in the hands of those who pursue them; [`goal_error`]. [`server`], on
//!   [`server_core`]: the state they share. [`client`]: those who sent them.
//! - [`serve`], [`serve_async`], [`follow`]: how workers get the handles. [`pursue`]: goals that
//!   are awaited. [`ids`]: names and stamps of goals.
//!
//! Everything is allocated when the server or client is made, for a fixed number of goals. One more
//! is rejected (server) or an error (client) that names the limit.

mod client;
mod follow;
mod goal;
pub(crate) mod goal_error;
mod ids;
mod pursue;
mod serve;
mod serve_async;
mod server;
mod server_core;
mod state;
mod table;

pub use client::{ActionClient, GoalUpdate, Lost};
pub use goal::{GoalHandle, GoalId, NewGoal};
pub use goal_error::GoalError;
pub use pursue::{AcceptedGoal, GoalCall, ResultCall};
pub use serve_async::RunningGoal;
pub use state::{GoalEvent, GoalState};

use crate::context::Node;
use crate::error::Error;
use crate::executor::Topic;
use crate::middleware::remedy::LARGEST;
use crate::process::Kind;
use crate::qos::Qos;
use crate::service::size::checked;
use alloc::string::String;
use core::time::Duration;
use replenish_msg::Message;
use replenish_msg::action_msgs::MAX_GOALS;

/// Limits of an action server or client: numbers of goals, and times.
///
/// ```
/// use replenish::ActionOptions;
/// use std::time::Duration;
/// let options = ActionOptions::goals(4).keep_results(Duration::from_secs(60));
/// # let _ = options;
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ActionOptions {
    goals: usize,
    askers: usize,
    keep: Duration,
    reply: Duration,
    result: Duration,
    feedback: u16,
    size: Option<usize>,
}

impl ActionOptions {
    /// Allows at most `goals` goals at a time, 1..=64. A server counts ended goals, too, until
    /// their results expire, or until a client has got the result and room is needed.
    #[must_use]
    pub const fn goals(goals: usize) -> Self {
        Self {
            goals,
            askers: 4,
            keep: Duration::from_secs(10),
            reply: Duration::from_secs(5),
            result: Duration::MAX,
            feedback: 10,
            size: None,
        }
    }

    /// Server: the most clients that wait for the result of one goal, 1..=64. Default 4.
    #[must_use]
    pub const fn askers(self, askers: usize) -> Self {
        Self { askers, ..self }
    }

    /// Server: how long after its end a goal can be asked for. Default 10 s, as in ROS 2.
    #[must_use]
    pub const fn keep_results(self, time: Duration) -> Self {
        Self { keep: time, ..self }
    }

    /// Client: how long the server has to answer a goal or a request to cancel. Default 5 s.
    #[must_use]
    pub const fn reply_within(self, time: Duration) -> Self {
        Self {
            reply: time,
            ..self
        }
    }

    /// Client: how long a goal may take from its acceptance to its result. Default: no limit.
    #[must_use]
    pub const fn result_within(self, time: Duration) -> Self {
        Self {
            result: time,
            ..self
        }
    }

    /// Client: how many messages of feedback wait for the callback, 1..=4096. Default 10.
    #[must_use]
    pub const fn feedback_depth(self, depth: u16) -> Self {
        Self {
            feedback: depth,
            ..self
        }
    }

    /// The name in full of the action that `topic` asks for, and the options for it.
    fn of(self, node: &Node, topic: &Topic<'_>) -> Result<(String, Self), Error> {
        let name = node.resolve(Kind::Action, topic.name)?;
        let size = topic.max_size;
        let options = Self { size, ..self };
        options.check(&name)?;
        topic.check_plain("action", &name, "with topics only")?;
        Ok((name, options))
    }

    /// The topic or service `name` with messages of this size.
    fn topic<'t, M: Message>(&self, name: &'t str) -> Topic<'t> {
        match self.size::<M>() {
            Some(size) => Topic::named(name).max_size(size),
            None => Topic::named(name),
        }
    }

    /// The size for messages of `M`, if it was said and matters.
    fn size<M: Message>(&self) -> Option<usize> {
        self.size.filter(|_| !M::BOUNDED)
    }

    /// The first setting of the action `name` that is out of range.
    fn check(&self, name: &str) -> Result<(), Error> {
        let owner = || alloc::format!("action {name}");
        let range = 1..=MAX_GOALS;
        for (field, value) in [("goals", self.goals), ("askers", self.askers)] {
            if !range.contains(&value) {
                return Err(Error::parameter(owner(), field, &value, "1..=64"));
            }
        }
        checked(("action", name), self.size, (0, LARGEST), self.services())?;
        if !(1..=Qos::MAX_DEPTH).contains(&self.feedback) {
            let depth = self.feedback;
            return Err(Error::parameter(
                owner(),
                "feedback_depth",
                &depth,
                "1..=4096",
            ));
        }
        Ok(())
    }

    /// The quality of the services: reliable, with room for a request of every goal and its
    /// client's other ones.
    fn services(&self) -> Qos {
        let depth = u16::try_from(self.goals.max(10)).unwrap_or(u16::MAX);
        Qos::reliable().keep_last(depth)
    }
}

/// The quality of the status topic in ROS 2: the latest, also for readers that come later.
fn status_qos() -> Qos {
    Qos::reliable().keep_last(1).transient_local()
}

/// A part of the action `name`.
fn part(name: &str, part: &str) -> String {
    alloc::format!("{name}/_action/{part}")
}
