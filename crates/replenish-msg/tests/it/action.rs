//! The types that an action brings along: their names, their bytes and their bounds.

use replenish_msg::action::{
    FeedbackMessage, GetResult, GetResultRequest, GetResultResponse, SendGoal, SendGoalRequest,
    SendGoalResponse,
};
use replenish_msg::action_msgs::{
    CancelGoalRequest, CancelGoalResponse, GoalInfo, GoalStatus, GoalStatusArray, MAX_GOALS,
};
use replenish_msg::builtin_interfaces::Time;
use replenish_msg::std_msgs::{Float64, Int32, UInt8};
use replenish_msg::unique_identifier_msgs::UUID;
use replenish_msg::{Action, CdrError, Message, Service, decode, encode};

struct Turn;

impl Action for Turn {
    type Goal = Int32;
    type Result = Float64;
    type Feedback = UInt8;
    const TYPE_NAME: &'static str = "turtle/action/Turn";
    const DDS_TYPE_NAME: &'static str = "turtle::action::dds_::Turn_";
}

const ID: UUID = UUID {
    uuid: *b"0123456789abcdef",
};
const STAMP: Time = Time { sec: 1, nanosec: 2 };

fn bytes<M: Message>(message: &M) -> Vec<u8> {
    let mut buf = vec![0; M::MAX_SIZE];
    let len = encode(message, &mut buf).unwrap();
    buf.truncate(len);
    buf
}

#[test]
fn names_are_those_of_ros() {
    fn of<M: Message>() -> [&'static str; 2] {
        [M::TYPE_NAME, M::DDS_TYPE_NAME]
    }
    let dds = "turtle::action::dds_::Turn_";
    for (names, ros, suffix) in [
        (
            of::<SendGoalRequest<Turn>>(),
            "SendGoal_Request",
            "SendGoal_Request_",
        ),
        (
            of::<SendGoalResponse<Turn>>(),
            "SendGoal_Response",
            "SendGoal_Response_",
        ),
        (
            of::<GetResultRequest<Turn>>(),
            "GetResult_Request",
            "GetResult_Request_",
        ),
        (
            of::<GetResultResponse<Turn>>(),
            "GetResult_Response",
            "GetResult_Response_",
        ),
        (
            of::<FeedbackMessage<Turn>>(),
            "FeedbackMessage",
            "FeedbackMessage_",
        ),
    ] {
        assert_eq!(
            names,
            [
                &format!("turtle/action/Turn_{ros}"),
                &format!("{dds}{suffix}")
            ]
        );
    }
    assert_eq!(
        <SendGoal<Turn> as Service>::TYPE_NAME,
        "turtle/action/Turn_SendGoal"
    );
    assert_eq!(
        <GetResult<Turn> as Service>::TYPE_NAME,
        "turtle/action/Turn_GetResult"
    );
}

#[test]
fn bytes_are_aligned_like_one_message() {
    let goal = Int32 { data: 7 };
    let request = SendGoalRequest::<Turn> { goal_id: ID, goal };
    assert_eq!(bytes(&request), [&ID.uuid[..], &[7, 0, 0, 0]].concat());
    let response = SendGoalResponse::<Turn>::new(true, STAMP);
    assert_eq!(bytes(&response), [1, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
    assert_eq!(bytes(&GetResultRequest::<Turn>::new(ID)), ID.uuid);
    let result = Float64 { data: 1.5 };
    let answer = GetResultResponse::<Turn> { status: 4, result };
    let status = [4, 0, 0, 0, 0, 0, 0, 0];
    assert_eq!(bytes(&answer), [status, 1.5_f64.to_le_bytes()].concat());
    let feedback = UInt8 { data: 9 };
    let message = FeedbackMessage::<Turn> {
        goal_id: ID,
        feedback,
    };
    assert_eq!(bytes(&message), [&ID.uuid[..], &[9]].concat());
    let mut back = GetResultResponse::<Turn>::default();
    decode(&mut back, &bytes(&answer)).unwrap();
    assert_eq!((back.status, back.result.data), (4, 1.5));
}

#[test]
fn what_all_actions_share_comes_back_as_it_was_and_is_bounded() {
    let goal_info = GoalInfo {
        goal_id: ID,
        stamp: STAMP,
    };
    let mut all = GoalStatusArray::default();
    let mut cancel = CancelGoalResponse::default();
    for _ in 0..MAX_GOALS {
        let status = GoalStatus::STATUS_CANCELING;
        all.status_list
            .push(GoalStatus { goal_info, status })
            .unwrap();
        cancel.goals_canceling.push(goal_info).unwrap();
    }
    let encoded = bytes(&all);
    assert_eq!(
        encoded.len() + 3,
        GoalStatusArray::MAX_SIZE,
        "no padding behind the last"
    );
    let mut back = GoalStatusArray::default();
    decode(&mut back, &encoded).unwrap();
    assert_eq!(back, all);
    let mut back = CancelGoalResponse::default();
    decode(&mut back, &bytes(&cancel)).unwrap();
    assert_eq!(back, cancel);
    let mut back = CancelGoalRequest::default();
    decode(&mut back, &bytes(&CancelGoalRequest { goal_info })).unwrap();
    assert_eq!(back.goal_info, goal_info);

    let mut more = encoded;
    more[0] += 1;
    let (len, limit) = (MAX_GOALS + 1, MAX_GOALS);
    let refused = decode(&mut GoalStatusArray::default(), &more);
    assert_eq!(refused, Err(CdrError::TooLong { len, limit }));
    assert_eq!(ID.to_string(), "30313233-3435-3637-3839-616263646566");
}
