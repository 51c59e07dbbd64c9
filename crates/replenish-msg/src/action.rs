//! Actions: the [`Action`] trait, and the services and messages that every action brings along.
//!
//! Action `Fibonacci` of package `p` uses these types on the wire; those of one action are made
//! from its goal, result and feedback, the others are in [`action_msgs`](crate::action_msgs):
//!
//! | part | type | here |
//! |---|---|---|
//! | service `send_goal` | `p/action/Fibonacci_SendGoal` | [`SendGoal<A>`] |
//! | service `get_result` | `p/action/Fibonacci_GetResult` | [`GetResult<A>`] |
//! | topic `feedback` | `p/action/Fibonacci_FeedbackMessage` | [`FeedbackMessage<A>`] |
//! | service `cancel_goal` | `action_msgs/srv/CancelGoal` | [`CancelGoal`](crate::action_msgs::CancelGoal) |
//! | topic `status` | `action_msgs/msg/GoalStatusArray` | [`GoalStatusArray`](crate::action_msgs::GoalStatusArray) |

use crate::builtin_interfaces::Time;
use crate::structure::fields;
use crate::unique_identifier_msgs::UUID;
use crate::{CdrError, CdrReader, CdrWriter, Message, Service};
use core::marker::PhantomData;

/// A ROS 2 action: a goal, feedback on the way there, and a result.
pub trait Action: 'static {
    /// A client's goal.
    type Goal: Message;
    /// The answer at the goal's end.
    type Result: Message;
    /// The reports until then.
    type Feedback: Message;

    /// The ROS name, such as `example_interfaces/action/Fibonacci`.
    const TYPE_NAME: &'static str;

    /// The beginning of the DDS names of the action's types, such as
    /// `example_interfaces::action::dds_::Fibonacci_`.
    const DDS_TYPE_NAME: &'static str;

    /// The type's hash, `RIHS01_` and 64 hexadecimal digits (ROS REP 2016), if it is known.
    const TYPE_HASH: Option<&'static str> = None;
}

/// The longest name of a type of an action, in bytes.
const LONGEST: usize = 256;

/// `a` followed by `b`, and how long that is.
const fn joined(a: &str, b: &str) -> ([u8; LONGEST], usize) {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut name = [0; LONGEST];
    let (front, rest) = name.split_at_mut(a.len());
    front.copy_from_slice(a);
    rest.split_at_mut(b.len()).0.copy_from_slice(b);
    (name, a.len() + b.len())
}

/// A joined name as text.
const fn text((name, len): &'static ([u8; LONGEST], usize)) -> &'static str {
    match core::str::from_utf8(name.split_at(*len).0) {
        Ok(text) => text,
        Err(_) => "", // two texts in a row are text
    }
}

/// The names of a message: those of the action with something behind.
macro_rules! names {
    ($suffix:literal) => {
        const TYPE_NAME: &'static str =
            text(&const { joined(A::TYPE_NAME, concat!("_", $suffix)) });
        const DDS_TYPE_NAME: &'static str =
            text(&const { joined(A::DDS_TYPE_NAME, concat!($suffix, "_")) });
    };
}

/// `A_SendGoal`: may this goal be pursued?
#[derive(Clone, Copy, Debug)]
pub struct SendGoal<A>(PhantomData<fn(&A)>);

impl<A: Action> Service for SendGoal<A> {
    type Request = SendGoalRequest<A>;
    type Response = SendGoalResponse<A>;
    const TYPE_NAME: &'static str = text(&const { joined(A::TYPE_NAME, "_SendGoal") });
}

/// `A_GetResult`: what has come of this goal? Answered when it has ended.
#[derive(Clone, Copy, Debug)]
pub struct GetResult<A>(PhantomData<fn(&A)>);

impl<A: Action> Service for GetResult<A> {
    type Request = GetResultRequest<A>;
    type Response = GetResultResponse<A>;
    const TYPE_NAME: &'static str = text(&const { joined(A::TYPE_NAME, "_GetResult") });
}

/// The request of [`SendGoal`].
pub struct SendGoalRequest<A: Action> {
    /// The client's name for the goal.
    pub goal_id: UUID,
    /// The goal.
    pub goal: A::Goal,
}

impl<A: Action> Message for SendGoalRequest<A> {
    names!("SendGoal_Request");
    fields!(
        Self::TYPE_NAME,
        "goal_id": One, Nested(UUID::STRUCTURE),
        "goal": One, Nested(A::Goal::STRUCTURE)
    );
    const MAX_SIZE: usize = UUID::MAX_SIZE + A::Goal::MAX_SIZE;
    const BOUNDED: bool = A::Goal::BOUNDED;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        self.goal_id.encode(w)?;
        self.goal.encode(w)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.goal_id.decode(r)?;
        self.goal.decode(r)
    }
}

/// The response of [`SendGoal`].
pub struct SendGoalResponse<A> {
    /// Whether the goal is pursued.
    pub accepted: bool,
    /// Since when, by the server's wall clock.
    pub stamp: Time,
    action: PhantomData<fn(&A)>,
}

impl<A> SendGoalResponse<A> {
    /// An answer.
    #[must_use]
    pub const fn new(accepted: bool, stamp: Time) -> Self {
        let action = PhantomData;
        Self {
            accepted,
            stamp,
            action,
        }
    }
}

impl<A: Action> Message for SendGoalResponse<A> {
    names!("SendGoal_Response");
    fields!(
        Self::TYPE_NAME,
        "accepted": One, Bool,
        "stamp": One, Nested(Time::STRUCTURE)
    );
    const MAX_SIZE: usize = 4 + Time::MAX_SIZE;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.bool(self.accepted)?;
        self.stamp.encode(w)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.accepted = r.bool()?;
        self.stamp.decode(r)
    }
}

/// The request of [`GetResult`].
pub struct GetResultRequest<A> {
    /// Id of the goal.
    pub goal_id: UUID,
    action: PhantomData<fn(&A)>,
}

impl<A> GetResultRequest<A> {
    /// A question.
    #[must_use]
    pub const fn new(goal_id: UUID) -> Self {
        let action = PhantomData;
        Self { goal_id, action }
    }
}

impl<A: Action> Message for GetResultRequest<A> {
    names!("GetResult_Request");
    fields!(
        Self::TYPE_NAME,
        "goal_id": One, Nested(UUID::STRUCTURE)
    );
    const MAX_SIZE: usize = UUID::MAX_SIZE;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        self.goal_id.encode(w)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.goal_id.decode(r)
    }
}

/// The response of [`GetResult`].
pub struct GetResultResponse<A: Action> {
    /// Status with which the goal ended: one of the constants of
    /// [`GoalStatus`](crate::action_msgs::GoalStatus).
    pub status: i8,
    /// The result; the type's default values if the server does not know the goal.
    pub result: A::Result,
}

impl<A: Action> Message for GetResultResponse<A> {
    names!("GetResult_Response");
    fields!(
        Self::TYPE_NAME,
        "status": One, Number(1),
        "result": One, Nested(A::Result::STRUCTURE)
    );
    const MAX_SIZE: usize = 8 + A::Result::MAX_SIZE;
    const BOUNDED: bool = A::Result::BOUNDED;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.i8(self.status)?;
        self.result.encode(w)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.status = r.i8()?;
        self.result.decode(r)
    }
}

/// `A_FeedbackMessage`: how far a goal has come.
pub struct FeedbackMessage<A: Action> {
    /// Id of the goal.
    pub goal_id: UUID,
    /// Progress of the goal.
    pub feedback: A::Feedback,
}

impl<A: Action> Message for FeedbackMessage<A> {
    names!("FeedbackMessage");
    fields!(
        Self::TYPE_NAME,
        "goal_id": One, Nested(UUID::STRUCTURE),
        "feedback": One, Nested(A::Feedback::STRUCTURE)
    );
    const MAX_SIZE: usize = UUID::MAX_SIZE + A::Feedback::MAX_SIZE;
    const BOUNDED: bool = A::Feedback::BOUNDED;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        self.goal_id.encode(w)?;
        self.feedback.encode(w)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.goal_id.decode(r)?;
        self.feedback.decode(r)
    }
}

/// Implements a default value and `Debug` for a message that belongs to an action. (Derived, these
/// would ask the same of the action.)
macro_rules! shown {
    ($($name:ident<$a:ident $(: $bound:ident)?> { $($field:ident),+ } $($phantom:ident)?;)+) => {$(
        impl<$a $(: $bound)?> Default for $name<$a> {
            fn default() -> Self {
                Self { $($field: Default::default(),)+ $($phantom: PhantomData)? }
            }
        }

        impl<$a $(: $bound)?> core::fmt::Debug for $name<$a> {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                f.debug_struct(stringify!($name)).finish_non_exhaustive()
            }
        }
    )+};
}

shown! {
    SendGoalRequest<A: Action> { goal_id, goal };
    SendGoalResponse<A> { accepted, stamp } action;
    GetResultRequest<A> { goal_id } action;
    GetResultResponse<A: Action> { status, result };
    FeedbackMessage<A: Action> { goal_id, feedback };
}
