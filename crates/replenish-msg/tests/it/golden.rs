//! Our bytes against those of an independent codec (`tests/data/rosbags-golden.txt`).
//!
//! Every line of the file is decoded and compared with the value it was made from; the
//! little-endian ones are also encoded and compared byte for byte.

use replenish_msg::builtin_interfaces::Time;
use replenish_msg::std_msgs::{
    Bool, BoundedHeader, BoundedString, Empty, Float64, Int32, Int64, MultiArrayDimension,
    MultiArrayLayout, UInt8MultiArray,
};
use replenish_msg::{CdrError, CdrReader, CdrWriter, Endianness, Message, encode};
use std::fmt::Debug;

/// The bounds that a program which states none has.
type Text = BoundedString;
type Stamped = BoundedHeader;

const GOLDEN: &str = include_str!("../data/rosbags-golden.txt");

/// Not a ROS type: one field of each alignment in an order that needs every padding.
#[derive(Clone, Debug, Default, PartialEq)]
struct Mixed {
    a: bool,
    b: f64,
    c: u8,
    d: u16,
    e: heapless::String<8>,
    f: i64,
    g: [u8; 3],
    h: f32,
}

impl Message for Mixed {
    const TYPE_NAME: &'static str = "test_msgs/msg/Mixed";
    const DDS_TYPE_NAME: &'static str = "test_msgs::msg::dds_::Mixed_";
    const MAX_SIZE: usize = 64;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.bool(self.a)?;
        w.f64(self.b)?;
        w.u8(self.c)?;
        w.u16(self.d)?;
        w.string(&self.e)?;
        w.i64(self.f)?;
        w.bytes(&self.g)?;
        w.f32(self.h)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.a = r.bool()?;
        self.b = r.f64()?;
        self.c = r.u8()?;
        self.d = r.u16()?;
        self.e = heapless::String::try_from(r.string(8)?).unwrap();
        self.f = r.i64()?;
        self.g.copy_from_slice(r.bytes(3)?);
        self.h = r.f32()?;
        Ok(())
    }
}

fn unhex(hex: &str) -> Vec<u8> {
    (0..hex.len())
        .step_by(2)
        .map(|i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap())
        .collect()
}

/// Checks all lines of `case` against `value`; there must be one per byte order.
fn check<M: Message + Debug + PartialEq>(case: &str, value: &M) {
    let mut orders = 0;
    for line in GOLDEN.lines().filter(|l| !l.starts_with('#')) {
        let [name, order, type_name, hex]: [&str; 4] =
            line.split(' ').collect::<Vec<_>>().try_into().unwrap();
        if name != case {
            continue;
        }
        orders += 1;
        assert_eq!(type_name, M::TYPE_NAME, "{case}");
        let bytes = unhex(hex);
        let order = if order == "le" {
            Endianness::Little
        } else {
            Endianness::Big
        };

        let mut decoded = M::default();
        let mut reader = CdrReader::with_order(&bytes, order);
        decoded.decode(&mut reader).unwrap();
        assert_eq!(&decoded, value, "{case} {order:?}");
        assert_eq!(reader.remaining(), 0, "{case} {order:?}");

        if order == Endianness::Little {
            let mut buf = vec![0xAA; M::MAX_SIZE];
            let len = encode(value, &mut buf).unwrap();
            assert_eq!(&buf[..len], bytes, "{case}");
        }
    }
    assert_eq!(orders, 2, "{case} is in the file once per byte order");
}

fn header(sec: i32, nanosec: u32, frame_id: &str) -> Stamped {
    Stamped {
        stamp: Time { sec, nanosec },
        frame_id: frame_id.try_into().unwrap(),
    }
}

fn dimension(label: &str, size: u32, stride: u32) -> MultiArrayDimension {
    MultiArrayDimension {
        label: label.try_into().unwrap(),
        size,
        stride,
    }
}

fn bytes(dim: &[MultiArrayDimension], data_offset: u32, data: &[u8]) -> UInt8MultiArray {
    let dim = dim.iter().cloned().collect();
    UInt8MultiArray {
        layout: MultiArrayLayout { dim, data_offset },
        data: data.iter().copied().collect(),
    }
}

#[test]
fn primitives_match_rosbags() {
    check("int32_7", &Int32 { data: 7 });
    check("int32_min", &Int32 { data: i32::MIN });
    check("int64", &Int64 { data: -2 });
    check("bool_true", &Bool { data: true });
    check("float64", &Float64 { data: -1.5 });
    check("empty", &Empty {});
    check(
        "time",
        &Time {
            sec: -5,
            nanosec: 999_999_999,
        },
    );
}

#[test]
fn text_matches_rosbags() {
    check("string_empty", &Text::default());
    check("string_hello", &Text::try_from("hello").unwrap());
    check("string_utf8", &Text::try_from("Grüße ☃").unwrap());
    check("header", &header(1_700_000_000, 123_456_789, "base_link"));
    check("header_empty", &header(0, 0, ""));
}

#[test]
fn arrays_match_rosbags() {
    check("bytes_plain", &bytes(&[], 0, &[1, 2, 3]));
    let dims = [dimension("height", 2, 6), dimension("w", 3, 3)];
    check("bytes_dims", &bytes(&dims, 1, &[0, 1, 2, 3, 4, 5, 255]));
    check("dimension", &dimension("abc", 1, 2));
}

#[test]
fn every_padding_matches_rosbags() {
    let e = heapless::String::try_from("xy").unwrap();
    check(
        "mixed",
        &Mixed {
            a: true,
            b: 0.5,
            c: 3,
            d: 0x1234,
            e,
            f: -3,
            g: [1, 2, 3],
            h: -2.0,
        },
    );
}
