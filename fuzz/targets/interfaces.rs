//! Generated messages, and the generator's parser: the first byte says which, the rest is the
//! input.
#![no_main]

use libfuzzer_sys::fuzz_target;
use replenish_interfaces::rcl_interfaces::msg::ParameterEvent;
use replenish_interfaces::test_msgs::msg::{
    Arrays, BoundedSequences, MultiNested, UnboundedSequences, WStrings,
};
use replenish_msg::{CdrReader, Endianness, View, Viewed, decode_with_path, encode};
use std::path::Path;

/// Owned value and view agree, and what was decoded is encoded and decoded again to the same bytes.
fn decoded<T: Viewed>(bytes: &[u8], order: Endianness) {
    let reader = CdrReader::with_order(bytes, order);
    let mut owned = T::default();
    let result = decode_with_path(&mut owned, &reader);
    let view = T::View::read(&reader);
    assert_eq!(result.err(), view.as_ref().err().copied());
    let Ok(view) = view else { return };
    let (mut one, mut two) = (vec![0; bytes.len() * 2 + 64], vec![0; bytes.len() * 2 + 64]);
    let len = encode(&owned, &mut one).unwrap();
    assert_eq!(view.encode_to(&mut two), Ok(len));
    assert_eq!(one[..len], two[..len]);
}

fuzz_target!(|bytes: &[u8]| {
    let Some((which, rest)) = bytes.split_first() else {
        return;
    };
    let order = match which & 1 {
        0 => Endianness::Little,
        _ => Endianness::Big,
    };
    let text = |file: &str| {
        if let Ok(text) = core::str::from_utf8(rest) {
            drop(replenish_msg_gen::check_text(Path::new(file), text));
        }
    };
    match which >> 1 {
        0 => decoded::<ParameterEvent>(rest, order),
        1 => decoded::<Arrays>(rest, order),
        2 => decoded::<BoundedSequences>(rest, order),
        3 => decoded::<MultiNested>(rest, order),
        4 => decoded::<UnboundedSequences>(rest, order),
        5 => decoded::<WStrings>(rest, order),
        6 => text("my_msgs/srv/Thing.srv"),
        _ => text("my_msgs/msg/Thing.msg"),
    }
});
