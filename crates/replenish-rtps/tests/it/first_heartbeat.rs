//! A reader that learns from the first heartbeat that it hears where it begins, as Cyclone DDS does
//! with samples of other implementations that are not transient local.

use crate::lossy::Dice;
use replenish_rtps::endpoint::{HostLimits, Writer, WriterLimits};
use replenish_rtps::wire::{
    AckNack, Bits, EntityId, Guid, GuidPrefix, Message, MessageWriter, Nanos, Qos, SequenceNumber,
    SequenceSet, Submessage,
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
