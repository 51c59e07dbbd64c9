//! The code that the generator made of `robot_msgs`.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::float_cmp,
    reason = "test code"
)]

use own_messages::inline;
use own_messages::robot_msgs::{action::Drive, msg::Status, msg::StatusView, srv::Grip};
use replenish_interfaces::geometry_msgs::msg::PoseStamped;
use replenish_msg::{
    Action, CdrError, CdrReader, Message, Service, View, decode_with_path, encode,
};

fn status() -> Status {
    let mut pose = PoseStamped::default();
    pose.pose.orientation.w = 0.5;
    Status {
        faults: vec!["hot".into(), "late".into()],
        plan: vec![PoseStamped::default(), pose],
        ..Status::default()
    }
}

fn bytes(message: &impl Message) -> Vec<u8> {
    let mut buf = vec![0; 4096];
    let len = encode(message, &mut buf).unwrap();
    buf.truncate(len);
    buf
}

#[test]
fn constants_and_defaults_are_those_of_the_file() {
    assert_eq!((Status::MODE_IDLE, StatusView::MODE_DRIVING), (0, 1));
    assert_eq!((Status::GREETING, Status::LIMIT), ("it's # fine", -0.0015));
    assert_eq!(Status::WIDE, "größe \"1\"");
    let status = Status::default();
    assert_eq!((status.mode, status.name.as_str()), (1, "robo \"one\""));
    assert_eq!((&*status.label, &status.wheels[..]), ("Grüße", &[1, 2][..]));
    assert_eq!(status.position, [1.0, 2.5, -3.0]);
    assert_eq!(<Grip as Service>::Request::default().force, 2.0);
    assert!(
        own_messages::robot_msgs::msg::Battery::default()
            .voltage
            .is_nan()
    );
    // A view has them too, but for sequences: there is nothing to borrow.
    let view = StatusView::default();
    assert_eq!(
        (view.name, view.label.to_string()),
        ("robo \"one\"", "Grüße".into())
    );
}

#[test]
fn types_of_other_packages_are_those_of_replenish_interfaces() {
    let header: replenish_interfaces::std_msgs::msg::Header = status().header;
    assert_eq!(header.frame_id, "");
    let goal: <Drive as Action>::Goal = Default::default();
    let _: replenish_interfaces::geometry_msgs::msg::Pose = goal.goal;
    assert_eq!(Drive::DDS_TYPE_NAME, "robot_msgs::action::dds_::Drive_");
    assert!(Drive::TYPE_HASH.is_some() && Grip::TYPE_HASH.is_some());
}

#[test]
fn the_inline_variant_is_the_same_type_on_the_wire() {
    use inline::robot_msgs::msg::Status as Inline;
    assert_eq!(Inline::TYPE_HASH, Status::TYPE_HASH);
    assert_eq!(Inline::STRUCTURE.name, Status::STRUCTURE.name);
    const { assert!(Inline::BOUNDED && !Status::BOUNDED) };
    let mut inline = Inline::default();
    let sent = bytes(&status());
    decode_with_path(&mut inline, &CdrReader::new(&sent)).unwrap();
    assert_eq!(inline.faults.as_slice(), ["hot", "late"]);
    assert_eq!(bytes(&inline), sent);
}

#[test]
fn what_does_not_fit_a_bound_is_an_error_with_its_path() {
    use inline::robot_msgs::msg::Status as Inline;
    let mut long = status();
    long.faults.push("x".repeat(33));
    let sent = bytes(&long);
    let error = decode_with_path(&mut Inline::default(), &CdrReader::new(&sent)).unwrap_err();
    assert_eq!(error.error, CdrError::TooLong { len: 33, limit: 32 });
    assert_eq!(error.path().to_string(), "faults[2]");

    let at = sent
        .windows(8)
        .position(|w| w == 0.5f64.to_le_bytes())
        .unwrap();
    let error = StatusView::from_payload(&sent[..at + 3]).unwrap_err();
    let text = "plan[1].pose.orientation.w: needs 8 bytes, 3 left";
    assert_eq!(error.to_string(), text);
    let error = decode_with_path(&mut Status::default(), &CdrReader::new(&sent[..at + 3]));
    assert_eq!(error.unwrap_err().to_string(), text);
}

#[test]
fn a_size_is_the_largest_of_an_inline_type() {
    use inline::robot_msgs::srv::{GripRequest, GripResponse};
    assert_eq!(GripRequest::MAX_SIZE, 4);
    assert_eq!(GripResponse::MAX_SIZE, 4 + 4 + 32 + 1);
    let full = GripResponse {
        message: "x".repeat(32).as_str().try_into().unwrap(),
        ..GripResponse::default()
    };
    assert_eq!(bytes(&full).len(), GripResponse::MAX_SIZE);
}
