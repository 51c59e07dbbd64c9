//! Sizes and errors: `MAX_SIZE` is exactly what the largest value takes, and every way in which
//! bytes can be wrong is named.

use replenish_msg::builtin_interfaces::Time;
use replenish_msg::std_msgs::{
    Bool, BoundedHeader, BoundedString, Int32, MAX_DIMENSIONS, MAX_LABEL, MultiArrayDimension,
    UInt8MultiArray,
};
use replenish_msg::{CdrError, CdrReader, CdrWriter, Message, decode, encode};

/// The bounds that a program which states none has.
type Text = BoundedString;
type Stamped = BoundedHeader;

fn largest_takes_max_size<M: Message>(value: &M) {
    let mut buf = vec![0; M::MAX_SIZE];
    assert_eq!(encode(value, &mut buf), Ok(M::MAX_SIZE), "{}", M::TYPE_NAME);

    let short = buf.len() - 1;
    let error = encode(value, &mut buf[..short]).unwrap_err();
    assert!(
        matches!(error, CdrError::EndOfBuffer { .. }),
        "{}: {error}",
        M::TYPE_NAME
    );
}

fn text<const N: usize>(len: usize) -> heapless::String<N> {
    heapless::String::try_from("x".repeat(len).as_str()).unwrap()
}

#[test]
fn max_size_is_what_the_largest_value_takes() {
    largest_takes_max_size(&Int32 { data: -1 });
    largest_takes_max_size(&Time {
        sec: -1,
        nanosec: 1,
    });
    largest_takes_max_size(&Text { data: text(255) });
    largest_takes_max_size(&BoundedString::<3> { data: text(3) });
    largest_takes_max_size(&Stamped {
        stamp: Time::default(),
        frame_id: text(255),
    });

    let dim = MultiArrayDimension {
        label: text(MAX_LABEL),
        size: 1,
        stride: 1,
    };
    largest_takes_max_size(&dim);
    let mut array = UInt8MultiArray::default();
    for _ in 0..MAX_DIMENSIONS {
        array.layout.dim.push(dim.clone()).unwrap();
    }
    array.data.resize(4096, 0xFF).unwrap();
    largest_takes_max_size(&array);
}

#[test]
fn nothing_is_written_of_an_item_that_does_not_fit() {
    let mut buf = [0xAA; 8];
    let mut w = CdrWriter::new(&mut buf);
    w.u8(1).unwrap();
    let end = CdrError::EndOfBuffer {
        at: 1,
        needed: 15,
        available: 7,
    };
    assert_eq!(w.u64(2), Err(end));
    assert!(w.string("abcd").is_err());
    assert_eq!(w.written(), [1]);
    w.u8(3).unwrap();
    assert_eq!(w.written(), [1, 3]);
}

#[test]
fn the_end_of_the_buffer_is_named() {
    let error = decode(&mut Int32::default(), &[1, 2]).unwrap_err();
    assert_eq!(
        error,
        CdrError::EndOfBuffer {
            at: 0,
            needed: 4,
            available: 2
        }
    );
    assert_eq!(
        error.to_string(),
        "buffer ends at offset 0: 4 bytes needed, 2 available"
    );

    let mut r = CdrReader::new(&[1, 0]);
    r.u8().unwrap();
    let end = CdrError::EndOfBuffer {
        at: 1,
        needed: 15,
        available: 1,
    };
    assert_eq!(r.u64(), Err(end));
    assert_eq!(r.u8(), Ok(0), "a failed read takes nothing");
}

#[test]
fn a_bad_string_is_named() {
    let parse = |bytes: &[u8]| decode(&mut BoundedString::<4>::default(), bytes).unwrap_err();
    let not_utf8 = parse(b"\x04\0\0\0a\xFFb\0");
    assert_eq!(not_utf8, CdrError::NotUtf8 { at: 5 });
    assert_eq!(not_utf8.to_string(), "string is not UTF-8 at offset 5");
    let no_nul = parse(b"\x03\0\0\0abc");
    assert_eq!(no_nul, CdrError::NotTerminated { at: 6 });
    assert_eq!(
        no_nul.to_string(),
        "string is not NUL-terminated at offset 6"
    );
    let long = parse(b"\x06\0\0\0abcde\0");
    assert_eq!(long, CdrError::TooLong { len: 5, limit: 4 });
    assert_eq!(
        long.to_string(),
        "length 5 is above the field's capacity of 4"
    );
    let cut = parse(b"\x05\0\0\0ab");
    assert_eq!(
        cut,
        CdrError::EndOfBuffer {
            at: 4,
            needed: 5,
            available: 2
        }
    );
    let huge = parse(b"\xFF\xFF\xFF\xFFab");
    assert_eq!(
        huge,
        CdrError::TooLong {
            len: u32::MAX as usize - 1,
            limit: 4
        }
    );
}

#[test]
fn a_string_without_bytes_is_empty() {
    let mut message = Text::try_from("old").unwrap();
    decode(&mut message, &[0, 0, 0, 0]).unwrap();
    assert_eq!(message.data, "");
}

#[test]
fn a_bad_bool_and_a_long_sequence_are_named() {
    let error = decode(&mut Bool::default(), &[2]).unwrap_err();
    assert_eq!(error, CdrError::NotBool { at: 0, value: 2 });
    assert_eq!(error.to_string(), "bool at offset 0 is 2, neither 0 nor 1");

    let dims = decode(&mut UInt8MultiArray::default(), &[5, 0, 0, 0]).unwrap_err();
    assert_eq!(
        dims,
        CdrError::TooLong {
            len: 5,
            limit: MAX_DIMENSIONS
        }
    );
    let data = decode(
        &mut UInt8MultiArray::default(),
        b"\0\0\0\0\0\0\0\0\x01\x10\0\0",
    );
    assert_eq!(
        data,
        Err(CdrError::TooLong {
            len: 4097,
            limit: 4096
        })
    );
}

#[test]
fn a_text_above_the_bound_is_refused() {
    let error = BoundedString::<4>::try_from("hello").unwrap_err();
    assert_eq!(error, CdrError::TooLong { len: 5, limit: 4 });
}
