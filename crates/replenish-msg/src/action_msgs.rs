//! The `action_msgs` package: what all actions have in common.

use crate::builtin_interfaces::Time;
use crate::structure::known;
use crate::unique_identifier_msgs::UUID;
use crate::{CdrError, CdrReader, CdrWriter, Message, Service, Viewed};
use heapless::Vec;

/// Goals that a [`GoalStatusArray`] or a [`CancelGoalResponse`] holds.
pub const MAX_GOALS: usize = 64;

/// `action_msgs/msg/GoalInfo`: which goal, and when it was accepted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct GoalInfo {
    /// The goal.
    pub goal_id: UUID,
    /// Time at which the server accepted it, by the server's wall clock.
    pub stamp: Time,
}

impl Message for GoalInfo {
    const TYPE_NAME: &'static str = "action_msgs/msg/GoalInfo";
    const DDS_TYPE_NAME: &'static str = "action_msgs::msg::dds_::GoalInfo_";
    const MAX_SIZE: usize = UUID::MAX_SIZE + Time::MAX_SIZE;
    known!(
        "6398fe763154554353930716b225947f93b672f0fb2e49fdd01bb7a7e37933e9",
        "action_msgs/msg/GoalInfo",
        "goal_id": One, Nested(UUID::STRUCTURE),
        "stamp": One, Nested(Time::STRUCTURE)
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        self.goal_id.encode(w)?;
        self.stamp.encode(w)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.goal_id.decode(r)?;
        self.stamp.decode(r)
    }
}

/// `action_msgs/msg/GoalStatus`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct GoalStatus {
    /// The goal.
    pub goal_info: GoalInfo,
    /// One of the constants of this type.
    pub status: i8,
}

impl GoalStatus {
    /// The server does not know the goal's state.
    pub const STATUS_UNKNOWN: i8 = 0;
    /// The goal was accepted and waits for its execution.
    pub const STATUS_ACCEPTED: i8 = 1;
    /// The goal is worked on.
    pub const STATUS_EXECUTING: i8 = 2;
    /// The goal shall end early, and has not ended yet.
    pub const STATUS_CANCELING: i8 = 3;
    /// The goal was reached.
    pub const STATUS_SUCCEEDED: i8 = 4;
    /// The goal ended early because a client cancelled it.
    pub const STATUS_CANCELED: i8 = 5;
    /// The goal ended early because the server could not reach it.
    pub const STATUS_ABORTED: i8 = 6;
}

impl Message for GoalStatus {
    const TYPE_NAME: &'static str = "action_msgs/msg/GoalStatus";
    const DDS_TYPE_NAME: &'static str = "action_msgs::msg::dds_::GoalStatus_";
    const MAX_SIZE: usize = GoalInfo::MAX_SIZE + 1;
    known!(
        "32f4cfd717735d17657e1178f24431c1ce996c878c515230f6c5b3476819dbb9",
        "action_msgs/msg/GoalStatus",
        "goal_info": One, Nested(GoalInfo::STRUCTURE),
        "status": One, Number(1)
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        self.goal_info.encode(w)?;
        w.i8(self.status)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.goal_info.decode(r)?;
        self.status = r.i8()?;
        Ok(())
    }
}

impl Viewed for GoalInfo {
    type View<'a> = Self;
}

impl Viewed for GoalStatus {
    type View<'a> = Self;
}

/// `action_msgs/msg/GoalStatusArray` of at most [`MAX_GOALS`] goals.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GoalStatusArray {
    /// All goals that the server knows.
    pub status_list: Vec<GoalStatus, MAX_GOALS>,
}

impl Message for GoalStatusArray {
    const TYPE_NAME: &'static str = "action_msgs/msg/GoalStatusArray";
    const DDS_TYPE_NAME: &'static str = "action_msgs::msg::dds_::GoalStatusArray_";
    const MAX_SIZE: usize = 4 + MAX_GOALS * crate::cdr::aligned(GoalStatus::MAX_SIZE, 4);
    known!(
        "6c1684b00f177d37438febe6e709fc4e2b0d4248dca4854946f9ed8b30cda83e",
        "action_msgs/msg/GoalStatusArray",
        "status_list": Sequence(MAX_GOALS), Nested(GoalStatus::STRUCTURE)
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.sequence(self.status_list.len())?;
        self.status_list.iter().try_for_each(|s| s.encode(w))
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        elements(&mut self.status_list, r)
    }
}

/// `action_msgs/srv/CancelGoal`: one goal, all goals, or those accepted up to some time.
#[derive(Clone, Copy, Debug)]
pub struct CancelGoal;

impl Service for CancelGoal {
    type Request = CancelGoalRequest;
    type Response = CancelGoalResponse;
    const TYPE_NAME: &'static str = "action_msgs/srv/CancelGoal";
}

/// The request of [`CancelGoal`].
///
/// With an id, that goal; with a stamp, those accepted then or before; with both, either; with
/// none (all zeros), every goal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct CancelGoalRequest {
    /// The id and the stamp.
    pub goal_info: GoalInfo,
}

impl Message for CancelGoalRequest {
    const TYPE_NAME: &'static str = "action_msgs/srv/CancelGoal_Request";
    const DDS_TYPE_NAME: &'static str = "action_msgs::srv::dds_::CancelGoal_Request_";
    const MAX_SIZE: usize = GoalInfo::MAX_SIZE;
    known!(
        "3d3c84653c1f96918086887e1dcb236faec88b81a5b14fd4cf4840065bcdf8af",
        "action_msgs/srv/CancelGoal_Request",
        "goal_info": One, Nested(GoalInfo::STRUCTURE)
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        self.goal_info.encode(w)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.goal_info.decode(r)
    }
}

/// The response of [`CancelGoal`], with at most [`MAX_GOALS`] goals.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CancelGoalResponse {
    /// One of the constants of this type.
    pub return_code: i8,
    /// The goals that are being canceled.
    pub goals_canceling: Vec<GoalInfo, MAX_GOALS>,
}

impl CancelGoalResponse {
    /// The request was carried out.
    pub const ERROR_NONE: i8 = 0;
    /// The server wants to cancel none of the goals.
    pub const ERROR_REJECTED: i8 = 1;
    /// The server has no goal with this id.
    pub const ERROR_UNKNOWN_GOAL_ID: i8 = 2;
    /// The goal has ended already.
    pub const ERROR_GOAL_TERMINATED: i8 = 3;
}

impl Message for CancelGoalResponse {
    const TYPE_NAME: &'static str = "action_msgs/srv/CancelGoal_Response";
    const DDS_TYPE_NAME: &'static str = "action_msgs::srv::dds_::CancelGoal_Response_";
    const MAX_SIZE: usize = 8 + MAX_GOALS * GoalInfo::MAX_SIZE;
    known!(
        "35e682cf3f510e83c70a82a4aac888496dedee56773bf9d8e5e0aa81f9e1c960",
        "action_msgs/srv/CancelGoal_Response",
        "return_code": One, Number(1),
        "goals_canceling": Sequence(MAX_GOALS), Nested(GoalInfo::STRUCTURE)
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.i8(self.return_code)?;
        w.sequence(self.goals_canceling.len())?;
        self.goals_canceling.iter().try_for_each(|g| g.encode(w))
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.return_code = r.i8()?;
        elements(&mut self.goals_canceling, r)
    }
}

/// Replaces the contents of `list` by the sequence that follows.
fn elements<T: Message>(
    list: &mut Vec<T, MAX_GOALS>,
    r: &mut CdrReader<'_>,
) -> Result<(), CdrError> {
    list.clear();
    for _ in 0..r.sequence(MAX_GOALS)? {
        let mut element = T::default();
        element.decode(r)?;
        list.push(element).ok(); // there is room: `sequence` has checked the number
    }
    Ok(())
}
