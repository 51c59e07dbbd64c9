//! A reader that learns from the first heartbeat that it hears where it begins, as Cyclone DDS does
//! with samples of other implementations that are not transient local.

use crate::lossy::Dice;
use replenish_rtps::endpoint::{HostLimits, Reader, ReaderLimits, Writer, WriterLimits};
use replenish_rtps::wire::{
    AckNack, Bits, CDR_LE, Data, EntityId, Guid, GuidPrefix, Heartbeat, Message, MessageWriter,
    Nanos, Payload, Qos, SequenceNumber, SequenceSet, Submessage,
};
use std::collections::BTreeSet;

const OWN: GuidPrefix = GuidPrefix([1; 12]);
const THEIRS: GuidPrefix = GuidPrefix([2; 12]);
const READER: EntityId = EntityId::reader(1);
const MILLI: Nanos = 1_000_000;
const LIMITS: WriterLimits = WriterLimits {
    samples: 8,
    sample_bytes: 8,
    readers: 2,
    fragment_bytes: 1200,
    memory: None,
    host: HostLimits::DEFAULT,
};

/// The reader: numbers below `next` came, or are no longer waited for.
#[derive(Default)]
struct Late {
    heard: bool,
    next: SequenceNumber,
    last: SequenceNumber,
    has: BTreeSet<SequenceNumber>,
    got: Vec<SequenceNumber>,
    count: u32,
}

impl Late {
    /// Takes a datagram in; `true` if it is to be answered.
    fn receive(&mut self, datagram: &[u8]) -> bool {
        let mut answer = false;
        for part in Message::decode(datagram).unwrap().submessages() {
            match part.unwrap() {
                Submessage::Data(data) if data.sn >= self.next => {
                    self.has.insert(data.sn);
                }
                Submessage::Heartbeat(body) => {
                    let begin = if self.heard {
                        body.first
                    } else {
                        body.last + 1
                    };
                    self.heard = true;
                    self.next = self.next.max(begin);
                    self.last = self.last.max(body.last);
                    answer |= !body.final_flag;
                }
                _ => {}
            }
        }
        while let Some(sn) = self.has.first().copied().filter(|sn| *sn <= self.next) {
            self.has.remove(&sn);
            self.got.push(sn);
            self.next = self.next.max(sn + 1);
        }
        answer
    }

    fn answer(&mut self) -> AckNack {
        let mut state = SequenceSet::empty(self.next.max(1));
        for sn in self.next..=self.last.min(self.next + i64::from(Bits::MAX) - 1) {
            if !self.has.contains(&sn) {
                state.insert(sn);
            }
        }
        self.count += 1;
        AckNack {
            reader: READER,
            writer: EntityId::writer(1),
            final_flag: state.iter().next().is_none(),
            state,
            count: self.count,
        }
    }
}

/// Three samples before the match, four after it, over a link that loses this part of a hundred.
fn samples_after_the_match(seed: u64, loss: u64) -> Vec<SequenceNumber> {
    let mut dice = Dice(seed);
    let mut writer = Writer::new(Guid::new(OWN, EntityId::writer(1)), Qos::ros(), &LIMITS);
    let (mut reader, mut now) = (Late::default(), 0);
    for number in 0..3 {
        writer.write(&[number; 8], None, now).unwrap();
    }
    let guid = Guid::new(THEIRS, READER);
    assert!(writer.add_reader(guid, &Qos::ros(), "10.0.0.7:7411".parse().unwrap(), now));
    let mut buf = [0; 1472];
    for step in 0..10_000_u32 {
        if (5..9).contains(&step) {
            writer.write(&[7; 8], None, now).unwrap();
        }
        loop {
            let mut m = MessageWriter::new(&mut buf, OWN).unwrap();
            if writer.transmit(now, &mut m).is_none() {
                break;
            }
            if dice.roll(100) >= loss && reader.receive(m.message()) && dice.roll(100) >= loss {
                writer.acknack(THEIRS, &reader.answer(), now);
            }
        }
        if step > 9 && writer.is_acknowledged() {
            return reader.got;
        }
        now += 5 * MILLI;
    }
    panic!("seed {seed}: never acknowledged")
}

/// The heartbeat of the match is lost, and the first sample as well.
#[test]
fn a_reader_gets_the_first_sample_after_its_match() {
    for seed in 1..=1000 {
        assert_eq!(
            samples_after_the_match(seed, 30),
            [4, 5, 6, 7],
            "seed {seed}"
        );
    }
}

/// The numbers that a volatile reader asks a latched writer for, after a heartbeat that has five
/// samples and, if it is so, a sixth one before it.
fn asks(writer: GuidPrefix, sixth: bool) -> (SequenceNumber, Vec<SequenceNumber>) {
    let limits = ReaderLimits {
        samples: 8,
        sample_bytes: 8,
        writers: 1,
    };
    let mut reader = Reader::new(Guid::new(OWN, READER), Qos::ros(), &limits);
    let writer = Guid::new(writer, EntityId::writer(1));
    let to = "10.0.0.7:7411".parse().unwrap();
    assert!(reader.add_writer(writer, &Qos::latched(5), to));
    let data = Data {
        reader: EntityId::UNKNOWN,
        writer: writer.entity,
        sn: 6,
        inline_qos: None,
        payload: Payload::Data(&CDR_LE),
    };
    if sixth {
        reader.data(writer.prefix, &data, None);
    }
    let heartbeat = Heartbeat {
        reader: EntityId::UNKNOWN,
        writer: writer.entity,
        first: 1,
        last: 5 + i64::from(sixth),
        count: 1,
        final_flag: false,
        liveliness: false,
    };
    reader.heartbeat(writer.prefix, &heartbeat);
    let (mut buf, mut asked) = ([0; 1472], None);
    let mut m = MessageWriter::new(&mut buf, OWN).unwrap();
    reader.transmit(0, &mut m).unwrap();
    for part in Message::decode(m.message()).unwrap().submessages() {
        if let Submessage::AckNack(body) = part.unwrap() {
            asked = Some((body.state.base, body.state.iter().collect()));
        }
    }
    assert_eq!(reader.take().map(|sample| sample.sn), sixth.then_some(6));
    assert_eq!(reader.stats().lost, 0);
    asked.unwrap()
}

/// Cyclone DDS sends what was latched before the match to whoever asks, but for its own readers.
#[test]
fn a_volatile_reader_does_not_ask_cyclone_for_what_was_latched() {
    let cyclone = GuidPrefix([1, 16, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
    assert_eq!(asks(cyclone, false), (6, vec![]));
    assert_eq!(asks(cyclone, true), (7, vec![]));
    // The others say in a GAP what is not for this reader.
    assert_eq!(asks(THEIRS, false), (1, vec![1, 2, 3, 4, 5]));
}
