//! Long sequences are whole wherever they lie in memory: where one lies a few bytes behind the
//! other modulo a page, they are copied in pieces.

use replenish_msg::heapless::Vec;
use replenish_msg::std_msgs::BoundedUInt8MultiArray;
use replenish_msg::wire::{DecodeInPlace, Encode};
use replenish_msg::{CdrReader, CdrWriter, decode, encode};

const PAGE: usize = 4096;
const COUNT: usize = 2500;

/// The places in `buffer` from which every distance of four bytes modulo a page is met.
fn starts() -> impl Iterator<Item = usize> {
    (0..PAGE).step_by(4)
}

fn numbers<T: Encode + DecodeInPlace + Copy + Default + PartialEq>(of: impl Fn(usize) -> T) {
    let sent: Vec<T, COUNT> = (0..COUNT).map(&of).collect();
    let mut got: Vec<T, COUNT> = Vec::new();
    let mut buffer = vec![0; PAGE + 8 * COUNT + 16];
    for start in starts() {
        let room = &mut buffer[start..];
        let mut w = CdrWriter::new(room);
        sent.put(&mut w).unwrap();
        got.clear();
        got.decode_in_place(&mut CdrReader::new(room)).unwrap();
        assert!(got == sent, "from byte {start} on");
    }
}

#[test]
fn sequences_of_numbers_are_whole_at_every_distance() {
    numbers(|at| at as u8);
    numbers(|at| at as u16);
    numbers(|at| at as f32);
    numbers(|at| (at as u64) << 32 | at as u64);
}

#[test]
fn bytes_are_whole_at_every_distance() {
    let mut sent = BoundedUInt8MultiArray::<{ 4 * COUNT }>::default();
    sent.data.extend((0..4 * COUNT).map(|at| at as u8));
    let mut got = BoundedUInt8MultiArray::default();
    let mut buffer = vec![0; PAGE + 4 * COUNT + 64];
    for start in starts() {
        let room = &mut buffer[start..];
        let len = encode(&sent, room).unwrap();
        decode(&mut got, &room[..len]).unwrap();
        assert!(got == sent, "from byte {start} on");
    }
}
