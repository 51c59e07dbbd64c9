//! Fragments of best-effort writers, which come once, at a reader with one place.

use replenish_rtps::endpoint::{Reader, ReaderLimits};
use replenish_rtps::wire::{
    DataFrag, EntityId, Guid, GuidPrefix, Qos, Reliability, SequenceNumber,
};

const SIZE: u16 = 8;
const QOS: Qos = Qos {
    reliability: Reliability::BestEffort,
    ..Qos::latched(1)
};

fn reader(writers: u32) -> Reader {
    let limits = ReaderLimits {
        samples: 1,
        sample_bytes: 1024,
        writers: writers as usize,
    };
    let mut reader = Reader::new(writer(0), QOS, &limits);
    for number in 1..=writers {
        assert!(reader.add_writer(writer(number), &QOS, "10.0.0.7:7411".parse().unwrap()));
    }
    reader
}

fn writer(number: u32) -> Guid {
    Guid::new(GuidPrefix([number as u8; 12]), EntityId::writer(number))
}

/// One of `of` fragments, the first of which is 1.
fn fragment(reader: &mut Reader, number: u32, sn: SequenceNumber, start: u32, of: u32) {
    let from = writer(number);
    let body = DataFrag {
        reader: EntityId::UNKNOWN,
        writer: from.entity,
        sn,
        start,
        count: 1,
        key: false,
        fragment_size: SIZE,
        sample_size: of * u32::from(SIZE),
        inline_qos: None,
        payload: &[number as u8; SIZE as usize],
    };
    reader.data_frag(from.prefix, &body, None);
}

fn taken(reader: &mut Reader) -> Vec<(u8, SequenceNumber)> {
    std::iter::from_fn(|| {
        let sample = reader.take()?;
        let from = sample.writer.prefix.0[0];
        assert!(sample.payload.iter().all(|byte| *byte == from));
        Some((from, sample.sn))
    })
    .collect()
}

/// Two and three cameras on one topic.
#[test]
fn samples_whose_fragments_come_in_turn_do_not_displace_each_other() {
    for writers in [2, 3] {
        let mut reader = reader(writers);
        for sn in 1..=3 {
            for start in 1..=4 {
                for number in 1..=writers {
                    fragment(&mut reader, number, sn, start, 4);
                }
            }
            assert_eq!(taken(&mut reader), [(1, sn)], "{writers} writers");
        }
    }
}

#[test]
fn a_fragment_that_is_overtaken_by_the_next_sample_does_not_displace_it() {
    let mut reader = reader(1);
    for (sn, start) in [(1, 1), (2, 1), (1, 2), (2, 2)] {
        fragment(&mut reader, 1, sn, start, 2);
    }
    assert_eq!(taken(&mut reader), [(1, 2)]);
}

/// A fragment is lost, and its writer says nothing any more: the sample keeps its place until the
/// second sample of another writer.
#[test]
fn a_sample_that_is_never_whole_gives_way() {
    let mut reader = reader(2);
    fragment(&mut reader, 1, 1, 1, 2);
    for sn in 1..=4 {
        for start in 1..=2 {
            fragment(&mut reader, 2, sn, start, 2);
        }
    }
    assert_eq!(taken(&mut reader), [(2, 4)]);
    assert_eq!(reader.stats().received, 3);
}
