//! Random values survive a round trip; random bytes never panic and never read past their end.

use proptest::collection::vec;
use proptest::prelude::*;
use replenish_msg::builtin_interfaces::Time;
use replenish_msg::std_msgs::{
    Bool, BoundedHeader, BoundedString, Empty, Float64, Int32, MAX_DIMENSIONS, MultiArrayDimension,
    MultiArrayLayout, UInt8MultiArray,
};
use replenish_msg::{CdrReader, Endianness, Message, decode, encode};
use std::fmt::Debug;

/// The bounds that a program which states none has.
type Text = BoundedString;
type Stamped = BoundedHeader;

fn round_trip<M: Message + Debug + PartialEq>(value: &M, stale: &mut M) {
    let mut buf = vec![0; M::MAX_SIZE];
    let len = encode(value, &mut buf).unwrap();
    decode(stale, &buf[..len]).unwrap();
    assert_eq!(stale, value);
    // Every prefix is an error, not a shorter message.
    for cut in 0..len {
        assert!(
            decode(&mut M::default(), &buf[..cut]).is_err(),
            "{cut} of {len}"
        );
    }
}

/// Decodes hostile bytes; if they pass, encoding the result gives a message that decodes equal.
fn survives<M: Message + Debug + PartialEq>(bytes: &[u8], order: Endianness) {
    let mut message = M::default();
    let mut reader = CdrReader::with_order(bytes, order);
    let ok = message.decode(&mut reader).is_ok();
    assert!(reader.position() <= bytes.len());
    let mut buf = vec![0; M::MAX_SIZE];
    let len = encode(&message, &mut buf).expect("a decoded value fits MAX_SIZE");
    if ok {
        let mut again = M::default();
        decode(&mut again, &buf[..len]).unwrap();
        // Bytes, because a NaN is not equal to itself.
        let mut second = vec![0; M::MAX_SIZE];
        let second_len = encode(&again, &mut second).unwrap();
        assert_eq!(buf[..len], second[..second_len]);
    }
}

fn text<const N: usize>() -> impl Strategy<Value = heapless::String<N>> {
    any::<std::string::String>().prop_map(|s| {
        let mut text = heapless::String::new();
        s.chars()
            .take_while(|c| text.push(*c).is_ok())
            .for_each(drop);
        text
    })
}

prop_compose! {
    fn header()(sec: i32, nanosec: u32, frame_id in text()) -> Stamped {
        Stamped { stamp: Time { sec, nanosec }, frame_id }
    }
}

prop_compose! {
    fn dimension()(label in text(), size: u32, stride: u32) -> MultiArrayDimension {
        MultiArrayDimension { label, size, stride }
    }
}

prop_compose! {
    fn array()(
        dim in vec(dimension(), 0..=MAX_DIMENSIONS),
        data_offset: u32,
        data in vec(any::<u8>(), 0..200),
    ) -> UInt8MultiArray {
        UInt8MultiArray {
            layout: MultiArrayLayout { dim: dim.into_iter().collect(), data_offset },
            data: data.into_iter().collect(),
        }
    }
}

/// Bytes that are often nearly right: small lengths at aligned places.
fn hostile() -> impl Strategy<Value = Vec<u8>> {
    let word = prop_oneof![
        (0u32..8).prop_map(u32::to_le_bytes),
        (0u32..8).prop_map(u32::to_be_bytes),
        any::<[u8; 4]>(),
        Just([b'a', b'b', b'c', 0]),
    ];
    (vec(word, 0..40), 0usize..4).prop_map(|(words, cut)| {
        let mut bytes = words.concat();
        bytes.truncate(bytes.len().saturating_sub(cut));
        bytes
    })
}

proptest! {
    #[test]
    fn values_survive_a_round_trip(data: i32, old: i32) {
        round_trip(&Int32 { data }, &mut Int32 { data: old });
    }

    #[test]
    fn strings_survive_a_round_trip(new in text(), old in text()) {
        round_trip(&Text { data: new }, &mut Text { data: old });
    }

    #[test]
    fn headers_survive_a_round_trip(new in header(), mut old in header()) {
        round_trip(&new, &mut old);
    }

    #[test]
    fn arrays_survive_a_round_trip(new in array(), mut old in array()) {
        round_trip(&new, &mut old);
    }

    #[test]
    fn hostile_bytes_never_panic(bytes in hostile(), big: bool) {
        let order = if big { Endianness::Big } else { Endianness::Little };
        survives::<Int32>(&bytes, order);
        survives::<Bool>(&bytes, order);
        survives::<Float64>(&bytes, order);
        survives::<Empty>(&bytes, order);
        survives::<Time>(&bytes, order);
        survives::<Text>(&bytes, order);
        survives::<Stamped>(&bytes, order);
        survives::<UInt8MultiArray>(&bytes, order);
    }
}
