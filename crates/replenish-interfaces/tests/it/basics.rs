//! The types one writes most: values, views, hashes, errors with the field's path.

use replenish_interfaces::action_msgs;
use replenish_interfaces::example_interfaces::action::FibonacciResult;
use replenish_interfaces::example_interfaces::msg::{WString, WStringView};
use replenish_interfaces::example_interfaces::{action::Fibonacci, srv::AddTwoInts};
use replenish_interfaces::rcl_interfaces::msg::{
    Parameter, ParameterEvent, ParameterEventView, ParameterType, ParameterValue,
};
use replenish_interfaces::std_msgs::msg::{self as std_msgs, HeaderView};
use replenish_msg::action::GetResultResponse;
use replenish_msg::{
    Action, CdrError, CdrReader, Message, Service, View, decode_encapsulated, decode_with_path,
    encode,
};

fn event() -> ParameterEvent {
    let parameter = |name: &str, list: &[&str]| Parameter {
        name: name.into(),
        value: ParameterValue {
            r#type: ParameterType::PARAMETER_STRING_ARRAY,
            string_array_value: list.iter().map(|s| (*s).into()).collect(),
            ..Default::default()
        },
    };
    ParameterEvent {
        node: "/node".into(),
        new_parameters: vec![parameter("a", &[]), parameter("speeds", &["x", "longer"])],
        ..Default::default()
    }
}

fn bytes(message: &impl Message) -> Vec<u8> {
    let mut buf = vec![0; 4096];
    let len = encode(message, &mut buf).unwrap();
    buf.truncate(len);
    buf
}

#[test]
fn what_is_encoded_is_decoded_owned_and_as_a_view() {
    let event = event();
    let bytes = bytes(&event);
    let mut owned = ParameterEvent::default();
    decode_with_path(&mut owned, &CdrReader::new(&bytes)).unwrap();
    assert_eq!(owned, event);

    let view = ParameterEventView::from_payload(&bytes).unwrap();
    assert_eq!(view.node, "/node");
    assert_eq!(view.new_parameters.len(), 2);
    let speeds = view.new_parameters.get(1).unwrap();
    assert_eq!(speeds.name, "speeds");
    assert!(speeds.value.string_array_value.iter().eq(["x", "longer"]));
    assert!(view.new_parameters.get(2).is_none());
    let mut again = [0; 4096];
    let len = view.encode_to(&mut again).unwrap();
    assert_eq!(again[..len], bytes);
    assert_eq!(ParameterEvent::from(view), event);
}

#[test]
fn a_view_is_made_from_what_one_has() {
    let header = HeaderView {
        frame_id: "map",
        ..Default::default()
    };
    let mut buf = [0; 32];
    let len = header.encode_to(&mut buf).unwrap();
    assert_eq!(buf[..len], *b"\0\0\0\0\0\0\0\0\x04\0\0\0map\0");
}

/// As Fast CDR 2 writes it (`Cdr::serialize(const wchar_t*)`): units, two bytes each, no NUL.
#[test]
fn a_wide_string_is_utf16_behind_its_number_of_units() {
    let message = WString {
        data: "hé𝄞".into()
    };
    let expected = b"\x04\0\0\0h\0\xe9\0\x34\xd8\x1e\xdd";
    assert_eq!(bytes(&message), expected);
    let view = WStringView::from_payload(expected).unwrap();
    assert!(view.data.chars().eq("hé𝄞".chars()));
    let half = b"\x01\0\0\0\x34\xd8";
    let error = WStringView::from_payload(half).unwrap_err();
    assert_eq!(error.to_string(), "data: wstring at offset 4 is not UTF-16");
}

#[test]
fn an_error_names_the_field() {
    let mut bytes = bytes(&event());
    let at = bytes.windows(6).position(|w| w == b"longer").unwrap();
    let view = |bytes: &[u8]| ParameterEventView::from_payload(bytes).unwrap_err();
    let owned = |bytes: &[u8]| {
        decode_with_path(&mut ParameterEvent::default(), &CdrReader::new(bytes)).unwrap_err()
    };
    let path = "new_parameters[1].value.string_array_value[1]";

    let cut = &bytes[..at + 3];
    assert_eq!(view(cut), owned(cut));
    assert_eq!(
        view(cut).to_string(),
        format!("{path}: needs 7 bytes, 3 left")
    );
    assert_eq!(view(cut).type_name(), "rcl_interfaces/msg/ParameterEvent");

    bytes[at + 1] = 0xff;
    let text = format!("{path}: string is not UTF-8 at offset {}", at + 1);
    assert_eq!(view(&bytes).to_string(), text);
    assert_eq!(owned(&bytes).to_string(), text);
    assert_eq!(owned(&bytes).path().to_string(), path);
}

#[test]
fn a_length_from_outside_takes_no_memory() {
    // A header, then four billion parameters.
    let mut bytes = bytes(&ParameterEvent::default());
    let at = bytes.len() - 12;
    bytes[at..at + 4].fill(0xff);
    let mut event = ParameterEvent::default();
    let error = decode_with_path(&mut event, &CdrReader::new(&bytes)).unwrap_err();
    assert!(event.new_parameters.capacity() < 64);
    assert!(error.path().to_string().starts_with("new_parameters["));
}

#[test]
fn an_encapsulation_header_says_the_byte_order() {
    let mut request = <AddTwoInts as Service>::Request::default();
    let big = [[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 7].as_slice(), &[0xff; 8]].concat();
    decode_encapsulated(&mut request, &big).unwrap();
    assert_eq!((request.a, request.b), (7, -1));

    let error = decode_encapsulated(&mut request, &[0, 7, 0, 0]).unwrap_err();
    assert_eq!(error.error, CdrError::Encapsulation { id: 7 });
}

#[test]
fn an_error_in_a_goal_is_found_through_the_types_of_the_action() {
    let result = GetResultResponse::<Fibonacci> {
        status: 4,
        result: FibonacciResult {
            sequence: vec![1, 2, 3],
        },
    };
    let bytes = bytes(&result);
    let reader = CdrReader::new(&bytes[..bytes.len() - 1]);
    let error = decode_with_path(&mut GetResultResponse::<Fibonacci>::default(), &reader);
    assert_eq!(
        error.unwrap_err().to_string(),
        "result.sequence[2]: needs 4 bytes, 3 left"
    );
}

/// The hand-written types and the generated ones of the same name are the same type in ROS.
#[test]
fn hand_written_types_have_the_hashes_of_the_generated() {
    fn same<A: Message, B: Message>() {
        assert_eq!((A::TYPE_NAME, A::TYPE_HASH), (B::TYPE_NAME, B::TYPE_HASH));
        let names = |s: &replenish_msg::Structure| s.fields.iter().map(|f| f.name).collect();
        let (a, b): (Vec<_>, Vec<_>) = (names(A::STRUCTURE), names(B::STRUCTURE));
        assert_eq!(a, b);
    }
    same::<replenish_msg::std_msgs::BoundedString, std_msgs::String>();
    same::<replenish_msg::std_msgs::BoundedHeader, std_msgs::Header>();
    same::<replenish_msg::std_msgs::UInt8MultiArray, std_msgs::UInt8MultiArray>();
    same::<replenish_msg::std_msgs::MultiArrayLayout, std_msgs::MultiArrayLayout>();
    same::<replenish_msg::action_msgs::GoalStatusArray, action_msgs::msg::GoalStatusArray>();
    same::<replenish_msg::action_msgs::CancelGoalRequest, action_msgs::srv::CancelGoalRequest>();
    same::<replenish_msg::action_msgs::CancelGoalResponse, action_msgs::srv::CancelGoalResponse>();
}

/// The first as ROS 2 Jazzy announces the service; it contains `service_msgs/msg/ServiceEventInfo`
/// with its `char[16]`.
#[test]
fn services_and_actions_have_hashes() {
    assert_eq!(
        AddTwoInts::TYPE_HASH,
        Some("RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a")
    );
    assert!(Fibonacci::TYPE_HASH.unwrap().starts_with("RIHS01_"));
}

#[test]
fn bounded_types_have_an_exact_size() {
    assert_eq!(<AddTwoInts as Service>::Request::MAX_SIZE, 16);
    const { assert!(<AddTwoInts as Service>::Request::BOUNDED) };
    const { assert!(!ParameterEvent::BOUNDED) };
    const { assert!(!GetResultResponse::<Fibonacci>::BOUNDED) };
}
