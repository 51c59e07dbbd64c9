//! One writer, readers beside it.

use proptest::prelude::*;
use replenish_recorder::{Copied, Event, Kind, Writer, read};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

fn ring(slots: usize) -> Vec<AtomicU64> {
    (0..8 + slots * 4).map(|_| AtomicU64::new(0)).collect()
}

fn event(n: u64) -> Event {
    Event {
        time: n,
        kind: Kind::ALL[(n % 16) as usize],
        name: n as u32,
        a: n.wrapping_mul(0x9e37_79b9_7f4a_7c15),
        b: !n,
    }
}

#[test]
fn a_ring_keeps_the_newest_records() {
    let ring = ring(8);
    let mut writer = Writer::new(ring.len()).unwrap();
    (0..21).for_each(|n| writer.write(&ring, &event(n)));
    let mut seen = Vec::new();
    let copied = read(&ring, 0, &mut [[0; 4]; 8], |event| seen.push(event));
    assert_eq!(seen, (13..21).map(event).collect::<Vec<_>>());
    let expected = Copied {
        read: 8,
        overwritten: 13,
        torn: 0,
        next: 21,
    };
    assert_eq!(copied, expected);
}

#[test]
fn a_ring_without_room_for_a_record_has_no_writer() {
    assert!(Writer::new(11).is_none());
    assert!(Writer::new(12).is_some());
    let short: Vec<AtomicU64> = Vec::new();
    Writer::new(12).unwrap().write(&short, &event(0));
    let copied = read(&short, 0, &mut [[0; 4]; 1], |_| unreachable!());
    assert_eq!(copied, Copied::default());
    let ring = ring(8);
    Writer::new(ring.len()).unwrap().write(&ring, &event(0));
    let copied = read(&ring, 0, &mut [[0; 4]; 7], |_| unreachable!());
    assert_eq!(copied, Copied::default(), "too little memory to copy");
}

proptest! {
    /// Written = read + overwritten, whenever somebody reads and however much came in between; the
    /// records are the newest, whole, and in order.
    #[test]
    fn written_is_read_plus_overwritten(
        shift in 0_u32..7,
        bursts in proptest::collection::vec(0_u64..200, 1..20),
    ) {
        let ring = ring(1 << shift);
        let mut writer = Writer::new(ring.len()).unwrap();
        let mut copy = vec![[0; 4]; 1 << shift];
        let (mut from, mut read_all, mut lost) = (0, 0, 0);
        for burst in bursts {
            (0..burst).for_each(|_| {
                let n = writer.written();
                writer.write(&ring, &event(n));
            });
            let mut seen = Vec::new();
            let copied = read(&ring, from, &mut copy, |event| seen.push(event));
            let first = writer.written() - copied.read;
            prop_assert_eq!(seen, (first..writer.written()).map(event).collect::<Vec<_>>());
            prop_assert_eq!(copied.torn, 0);
            from = copied.next;
            read_all += copied.read;
            lost += copied.overwritten;
        }
        prop_assert_eq!(writer.written(), read_all + lost);
    }
}

/// A reader on another thread while the writer laps it many times: whole records only, and the
/// counts add up.
#[test]
fn a_reader_beside_the_writer_gets_whole_records() {
    const WRITTEN: u64 = 2_000_000;
    let (ring, done) = (ring(1024), AtomicBool::new(false));
    let (mut from, mut total, mut lost, mut torn) = (0, 0, 0, 0);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut writer = Writer::new(ring.len()).unwrap();
            (0..WRITTEN).for_each(|n| writer.write(&ring, &event(n)));
            done.store(true, Ordering::Release);
        });
        let mut copy = vec![[0; 4]; 1024];
        loop {
            let last = done.load(Ordering::Acquire);
            let copied = read(&ring, from, &mut copy, |got| {
                assert_eq!(got, event(got.time));
            });
            from = copied.next;
            total += copied.read;
            lost += copied.overwritten;
            torn += copied.torn;
            if last {
                break;
            }
        }
    });
    assert_eq!(total + lost, WRITTEN);
    assert_eq!(torn, 0);
    assert!(total >= 1024);
}
