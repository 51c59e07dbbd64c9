//! One writer and two readers on other hosts over a bad link, in virtual time: each has its own
//! place in the samples, and none waits for the other's repairs.

use crate::lossy::{HOST, KEEP_ALL, Link, MILLI, W, payload};
use proptest::prelude::*;
use replenish_rtps::endpoint::{Reader, ReaderLimits, Writer, WriterLimits};
use replenish_rtps::wire::{
    AckNack, EntityId, Guid, GuidPrefix, Message, MessageWriter, Nanos, SequenceSet, Submessage,
};
use std::net::SocketAddr;

/// The participants of the readers; each has an address of its own.
const R: [GuidPrefix; 2] = [GuidPrefix([2; 12]), GuidPrefix([3; 12])];

fn address(reader: usize) -> SocketAddr {
    SocketAddr::from(([192, 0, 2, 1 + reader as u8], 7411))
}

fn writer(samples: usize) -> Writer {
    let limits = WriterLimits {
        samples,
        sample_bytes: 32_768,
        readers: 2,
        fragment_bytes: 700,
        memory: None,
        host: HOST,
    };
    let mut writer = Writer::new(Guid::new(W, EntityId::writer(1)), KEEP_ALL, &limits);
    for (at, prefix) in R.into_iter().enumerate() {
        let guid = Guid::new(prefix, EntityId::reader(1));
        assert!(writer.add_reader(guid, &KEEP_ALL, address(at), 1));
    }
    writer
}

/// The next datagram, and the reader that it is for.
fn next(writer: &mut Writer, now: Nanos, buf: &mut [u8]) -> Option<(usize, Vec<u8>)> {
    let mut m = MessageWriter::new(buf, W).unwrap();
    let to = writer.transmit(now, &mut m)?;
    let reader = (0..2).find(|at| address(*at) == to);
    Some((reader.unwrap(), m.message().to_vec()))
}

/// The ends of the link: the writer, or one of the readers.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum End {
    Writer { from: usize },
    Reader(usize),
}

struct Trio {
    writer: Writer,
    readers: [Reader; 2],
    link: Link<End>,
    now: Nanos,
}

impl Trio {
    fn new(samples: usize, seed: u64, loss: u64) -> Self {
        let room = ReaderLimits {
            samples,
            sample_bytes: 32_768,
            writers: 1,
        };
        let readers = R.map(|prefix| {
            let guid = Guid::new(prefix, EntityId::reader(1));
            let mut reader = Reader::new(guid, KEEP_ALL, &room);
            let from = SocketAddr::from(([192, 0, 2, 9], 7411));
            assert!(reader.add_writer(Guid::new(W, EntityId::writer(1)), &KEEP_ALL, from));
            reader
        });
        Self {
            writer: writer(samples),
            readers,
            link: Link::new(seed, loss),
            now: 1,
        }
    }

    /// Sends what there is, moves on to the next event, delivers.
    fn step(&mut self) {
        let mut buf = [0; 1472];
        while let Some((to, bytes)) = next(&mut self.writer, self.now, &mut buf) {
            self.link.send(self.now, End::Reader(to), &bytes);
        }
        for (from, reader) in self.readers.iter_mut().enumerate() {
            while reader.wants_to_transmit(self.now) {
                let mut m = MessageWriter::new(&mut buf, R[from]).unwrap();
                reader.transmit(self.now, &mut m).unwrap();
                self.link.send(self.now, End::Writer { from }, m.message());
            }
        }
        let timer = self.writer.next_at(self.now);
        assert!(timer > self.now, "nothing is left to send, yet it wants to");
        let next = timer.min(self.link.next_at());
        self.now = next.min(self.now + 1000 * MILLI);
        while let Some((to, bytes)) = self.link.arrived(self.now) {
            self.deliver(to, &bytes);
        }
    }

    fn deliver(&mut self, to: End, bytes: &[u8]) {
        for part in Message::decode(bytes).unwrap().submessages() {
            match (to, part.unwrap()) {
                (End::Reader(at), Submessage::Data(data)) => {
                    self.readers[at].data(W, &data, None);
                }
                (End::Reader(at), Submessage::DataFrag(data)) => {
                    self.readers[at].data_frag(W, &data, None);
                }
                (End::Reader(at), Submessage::Heartbeat(body)) => {
                    self.readers[at].heartbeat(W, &body);
                }
                (End::Reader(at), Submessage::Gap(body)) => self.readers[at].gap(W, &body),
                (End::Writer { from }, Submessage::AckNack(body)) => {
                    self.writer.acknack(R[from], &body, self.now);
                }
                (End::Writer { from }, Submessage::NackFrag(body)) => {
                    self.writer.nack_frag(R[from], &body, self.now);
                }
                _ => {}
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Runs of fragments go to one reader after the other, whatever is lost of either.
    #[test]
    fn both_get_every_sample_once_and_in_order(seed: u64, loss in 0..40u64, slots in 1..9usize,
            lens in prop::collection::vec(prop_oneof![0..64usize, 0..30_000usize], 1..20)) {
        let mut trio = Trio::new(slots, seed, loss);
        let sent: Vec<_> = lens.iter().enumerate()
            .map(|(number, len)| payload(number as u32, len.next_multiple_of(4))).collect();
        let (mut got, mut next) = ([Vec::new(), Vec::new()], 0);
        for _ in 0..200_000 {
            while sent.get(next).is_some_and(|sample| trio.writer.write(sample, None, trio.now).is_ok()) {
                next += 1;
            }
            trio.step();
            for (reader, got) in trio.readers.iter_mut().zip(&mut got) {
                while let Some(sample) = reader.take() {
                    got.push(sample.payload.to_vec());
                }
            }
            if got.iter().all(|got| got.len() == sent.len()) && trio.writer.is_acknowledged() { break; }
        }
        for (reader, got) in trio.readers.iter().zip(&got) {
            prop_assert_eq!(got.len(), sent.len(), "at {} ms", trio.now / MILLI);
            prop_assert!(*got == sent);
            prop_assert_eq!(reader.stats().lost, 0);
        }
        prop_assert!(trio.writer.is_acknowledged());
    }
}

/// A reader that asks for the same sample without end is amid a run of fragments: the other one's
/// repair comes all the same.
#[test]
fn a_repair_does_not_wait_for_the_end_of_a_run() {
    let (mut writer, now, mut buf) = (writer(4), 1, [0; 1472]);
    writer.write(&payload(1, 40), None, now).unwrap();
    writer.write(&payload(2, 20_000), None, now).unwrap();
    // The short sample to each, and the first fragments of the long one to one of them.
    let mut insatiable = 0;
    for _ in 0..6 {
        insatiable = next(&mut writer, now, &mut buf).unwrap().0;
    }
    let ask = |count| AckNack {
        reader: EntityId::reader(1),
        writer: EntityId::writer(1),
        state: {
            let mut state = SequenceSet::empty(1);
            state.insert(1);
            state
        },
        count,
        final_flag: true,
    };
    writer.acknack(R[1 - insatiable], &ask(1), now);
    let repaired = (1..=8).find(|count| {
        writer.acknack(R[insatiable], &ask(*count), now);
        let (to, datagram) = next(&mut writer, now, &mut buf).unwrap();
        let message = Message::decode(&datagram).unwrap();
        let mut parts = message.submessages();
        to != insatiable && parts.any(|part| matches!(part, Ok(Submessage::Data(_))))
    });
    assert!(repaired.is_some(), "eight repairs went to the other reader");
}
