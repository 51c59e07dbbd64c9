//! Samples in memory that a writer shares with a reader, in virtual time, over good and bad links.

use crate::lossy::Dice;
use proptest::prelude::*;
use replenish_rtps::endpoint::{
    Body, Fetch, Header, HostLimits, Reader, ReaderLimits, ReaderStats, WriteError, Writer,
    WriterLimits,
};
use replenish_rtps::wire::{
    CDR_LE, EntityId, Guid, GuidPrefix, Message, MessageWriter, Nanos, Qos, Reliability,
    SegmentName, SharedPlace, Submessage,
};
use std::net::SocketAddr;

const MILLI: Nanos = 1_000_000;
const W: GuidPrefix = GuidPrefix([0; 12]);
const R: GuidPrefix = GuidPrefix([2; 12]);
const NAME: SegmentName = SegmentName([7; 16]);
const MOST: usize = 100_000;
const KEEP_ALL: Qos = Qos {
    depth: 0,
    ..Qos::ros()
};

/// The writer's memory: a stamp and a sample in each slot.
struct Memory(Vec<(u64, Vec<u8>)>, u64);

impl Memory {
    fn put(&mut self, bytes: &[u8]) -> SharedPlace {
        self.1 += 1;
        let slot = self.1 as usize % self.0.len();
        self.0[slot] = (self.1, bytes.to_vec());
        SharedPlace {
            slot: slot as u32,
            stamp: self.1,
        }
    }

    fn read(&self, fetch: &mut Fetch) -> bool {
        let (stamp, bytes) = &self.0[fetch.place.slot as usize];
        let whole = *stamp == fetch.place.stamp;
        if whole {
            fetch.room().copy_from_slice(bytes);
        }
        whole
    }
}

/// A datagram under way: when, to which reader or to the writer, its bytes.
type Flying = (Nanos, Option<usize>, Vec<u8>);

struct Net {
    writer: Writer,
    readers: Vec<Reader>,
    memory: Memory,
    flying: Vec<Flying>,
    now: Nanos,
    dice: Dice,
    loss: u64,
    /// Of a hundred fetches, how many fail.
    torn: u64,
    /// Bytes on the way to readers, and fragments and references among them.
    sent: (usize, usize, usize),
}

fn address(at: usize) -> SocketAddr {
    ([127, 0, 0, 1], 8000 + at as u16).into()
}

fn payload(number: u32, len: usize) -> Vec<u8> {
    let body = (0..len).map(|i| (i as u32).wrapping_mul(number | 1) as u8);
    let head = CDR_LE.into_iter().chain(number.to_le_bytes());
    head.chain(body).collect()
}

impl Net {
    fn new(qos: Qos, samples: usize, seed: u64, loss: u64) -> Self {
        let limits = WriterLimits {
            samples,
            sample_bytes: MOST,
            readers: 4,
            fragment_bytes: 1200,
            memory: None,
            host: HostLimits::DEFAULT,
        };
        let mut dice = Dice(seed | 1);
        dice.roll(2);
        Net {
            writer: Writer::new(Guid::new(W, EntityId::writer(1)), qos, &limits),
            readers: Vec::new(),
            memory: Memory(vec![(0, Vec::new()); samples + 2], 0),
            flying: Vec::new(),
            now: 1,
            dice,
            loss,
            torn: 0,
            sent: (0, 0, 0),
        }
    }

    /// A reader that opens the writer's memory, or cannot.
    fn join(&mut self, samples: usize, open: Option<bool>) -> usize {
        let at = self.readers.len();
        let limits = ReaderLimits {
            samples,
            sample_bytes: MOST,
            writers: 2,
        };
        let (qos, own) = (*self.writer.qos(), self.writer.guid());
        let guid = Guid::new(R, EntityId::reader(at as u32));
        let mut reader = Reader::new(guid, qos, &limits);
        assert!(self.writer.add_reader(guid, &qos, address(at), self.now));
        assert!(reader.add_writer(own, &qos, address(99)));
        if let Some(open) = open {
            reader.offer(own, Some(NAME));
            assert_eq!(reader.wanted_segment(), Some((own, NAME)));
            reader.segment_opened(own, open);
        }
        assert_eq!(reader.wanted_segment(), None);
        self.readers.push(reader);
        at
    }

    fn write(&mut self, number: u32, len: usize) -> Result<(), WriteError> {
        let bytes = payload(number, len);
        if self.writer.is_full() {
            return Err(WriteError::Full);
        }
        let header = Header {
            shared: (len > 1000).then(|| self.memory.put(&bytes)),
            ..Header::default()
        };
        self.writer
            .write_with(Body::Parts(&[&bytes]), &header, self.now)
            .map(drop)
    }

    fn send(&mut self, to: Option<usize>, bytes: &[u8]) {
        for part in Message::decode(bytes).unwrap().submessages() {
            self.sent.1 += usize::from(matches!(part, Ok(Submessage::DataFrag(_))));
            self.sent.2 += usize::from(matches!(part, Ok(Submessage::Reference(_))));
        }
        self.sent.0 += if to.is_some() { bytes.len() } else { 0 };
        let copies = if self.loss > 0 {
            self.dice.roll(100) / 90
        } else {
            0
        };
        for _ in 0..=copies {
            if self.dice.roll(100) >= self.loss {
                let delay = if self.loss > 0 {
                    self.dice.roll(5 * MILLI)
                } else {
                    0
                };
                self.flying.push((self.now + delay, to, bytes.to_vec()));
            }
        }
    }

    fn step(&mut self) {
        let mut buf = vec![0; 65_000];
        loop {
            let mut m = MessageWriter::new(&mut buf, W).unwrap();
            let Some(to) = self.writer.transmit(self.now, &mut m) else {
                break;
            };
            let bytes = m.message().to_vec();
            self.send(Some(usize::from(to.port()) - 8000), &bytes);
        }
        for at in 0..self.readers.len() {
            while self.readers[at].wants_to_transmit(self.now) {
                let mut m = MessageWriter::new(&mut buf, R).unwrap();
                self.readers[at].transmit(self.now, &mut m).unwrap();
                let bytes = m.message().to_vec();
                self.send(None, &bytes);
            }
        }
        let next = self.flying.iter().map(|flying| flying.0).min();
        let timer = self.writer.next_at(self.now);
        assert!(timer > self.now, "nothing is left to send, yet it wants to");
        self.now = timer
            .min(next.unwrap_or(u64::MAX))
            .min(self.now + 1000 * MILLI);
        while let Some(at) = self.flying.iter().position(|flying| flying.0 <= self.now) {
            let (_, to, bytes) = self.flying.remove(at);
            self.deliver(to, &bytes);
        }
    }

    fn deliver(&mut self, to: Option<usize>, bytes: &[u8]) {
        for part in Message::decode(bytes).unwrap().submessages() {
            let part = part.unwrap();
            match (&part, to) {
                (Submessage::AckNack(body), None) => {
                    self.writer.acknack(R, body, self.now);
                }
                (Submessage::NackFrag(body), None) => self.writer.nack_frag(R, body, self.now),
                (Submessage::Shared(body), None) => self.writer.shared(R, body),
                (_, Some(at)) => {
                    let reader = &mut self.readers[at];
                    match part {
                        Submessage::Data(data) => reader.data(W, &data, None),
                        Submessage::DataFrag(data) => reader.data_frag(W, &data, None),
                        Submessage::Reference(body) => reader.reference(W, &body, None),
                        Submessage::Heartbeat(body) => reader.heartbeat(W, &body),
                        Submessage::Gap(body) => reader.gap(W, &body),
                        _ => {}
                    }
                }
                _ => {}
            }
        }
        if let Some(at) = to {
            while let Some(mut fetch) = self.readers[at].fetch() {
                let whole = self.dice.roll(100) >= self.torn && self.memory.read(&mut fetch);
                self.readers[at].fetched(fetch, whole, false);
            }
        }
    }

    /// Runs until the reader has taken `count` samples, or nothing happens for long.
    fn read(&mut self, at: usize, count: usize) -> Vec<Vec<u8>> {
        let mut got = Vec::new();
        for _ in 0..2000 {
            while let Some(sample) = self.readers[at].take() {
                got.push(sample.payload.to_vec());
            }
            if got.len() >= count {
                break;
            }
            self.step();
        }
        got
    }

    fn settle(&mut self) {
        for _ in 0..20 {
            self.step();
        }
    }

    fn stats(&self, at: usize) -> ReaderStats {
        self.readers[at].stats()
    }
}

#[test]
fn references_go_out_instead_of_fragments() {
    let mut net = Net::new(Qos::ros(), 10, 1, 0);
    let at = net.join(10, Some(true));
    net.settle();
    net.sent = (0, 0, 0);
    for number in 0..100 {
        net.write(number, 90_000).unwrap();
        assert_eq!(net.read(at, 1), [payload(number, 90_000)]);
    }
    net.settle();
    assert!(net.writer.is_acknowledged());
    let (bytes, fragments, references) = net.sent;
    assert_eq!((fragments, references), (0, 100));
    assert!(bytes < 100 * 200, "{bytes} bytes for a hundred samples");
}

#[test]
fn short_samples_go_as_ever_between_references() {
    let mut net = Net::new(KEEP_ALL, 10, 1, 0);
    let at = net.join(10, Some(true));
    net.settle();
    for number in 0..10 {
        net.write(number, if number % 2 == 0 { 90_000 } else { 8 })
            .unwrap();
    }
    let sent: Vec<_> = (0..10)
        .map(|number| payload(number, if number % 2 == 0 { 90_000 } else { 8 }))
        .collect();
    assert_eq!(net.read(at, 10), sent);
    assert_eq!((net.sent.1, net.sent.2), (0, 5));
}

#[test]
fn a_reader_that_cannot_open_the_memory_gets_fragments() {
    let mut net = Net::new(Qos::ros(), 10, 1, 0);
    let (shut, stranger) = (net.join(10, Some(false)), net.join(10, None));
    let open = net.join(10, Some(true));
    net.settle();
    for number in 0..5 {
        net.write(number, 90_000).unwrap();
        for at in [shut, stranger, open] {
            assert_eq!(net.read(at, 1), [payload(number, 90_000)]);
        }
    }
    assert_eq!(net.sent.2, 5);
    assert!(net.sent.1 > 0);
}

#[test]
fn a_reader_that_comes_late_gets_references_to_what_is_kept() {
    let mut net = Net::new(Qos::latched(3), 3, 1, 0);
    for number in 0..9 {
        net.write(number, 90_000).unwrap();
    }
    let at = net.join(3, Some(true));
    let kept: Vec<_> = (6..9).map(|number| payload(number, 90_000)).collect();
    assert_eq!(net.read(at, 3), kept);
}

/// The memory is that of another sample by now, or somebody wrote to it meanwhile.
#[test]
fn a_sample_that_could_not_be_fetched_comes_in_fragments() {
    let mut net = Net::new(Qos::ros(), 10, 1, 0);
    let at = net.join(10, Some(true));
    net.settle();
    net.torn = 100;
    for number in 0..3 {
        net.write(number, 90_000).unwrap();
        assert_eq!(net.read(at, 1), [payload(number, 90_000)]);
    }
    assert_eq!(net.sent.2, 3, "references go on");
    net.settle();
    net.torn = 0;
    let fragments = net.sent.1;
    net.write(3, 90_000).unwrap();
    assert_eq!(net.read(at, 1), [payload(3, 90_000)]);
    assert_eq!(net.sent.1, fragments);
}

#[test]
fn memory_that_broke_is_not_used_again() {
    let mut net = Net::new(Qos::ros(), 10, 1, 0);
    let at = net.join(10, Some(true));
    net.settle();
    let mut got = Vec::new();
    net.write(0, 90_000).unwrap();
    for _ in 0..200 {
        let mut buf = vec![0; 65_000];
        let mut m = MessageWriter::new(&mut buf, W).unwrap();
        if net.writer.transmit(net.now, &mut m).is_some() {
            for part in Message::decode(m.message())
                .unwrap()
                .submessages()
                .flatten()
            {
                match part {
                    Submessage::Reference(body) => net.readers[at].reference(W, &body, None),
                    _ => continue,
                }
            }
            let fetch = net.readers[at].fetch().expect("a sample to fetch");
            net.readers[at].fetched(fetch, false, true);
            break;
        }
        net.step();
    }
    got.extend(net.read(at, 1));
    net.settle();
    let references = net.sent.2;
    net.write(1, 90_000).unwrap();
    got.extend(net.read(at, 1));
    assert_eq!(got, [payload(0, 90_000), payload(1, 90_000)]);
    assert_eq!(net.sent.2, references, "no reference any longer");
}

/// The writer goes while its sample is being copied; the place is there for the next one.
#[test]
fn a_fetch_whose_writer_has_gone_leaves_no_trace() {
    let mut net = Net::new(Qos::ros(), 1, 1, 0);
    let at = net.join(1, Some(true));
    net.settle();
    let own = net.writer.guid();
    for number in 0..5 {
        net.write(number, 90_000).unwrap();
        let mut buf = vec![0; 65_000];
        let mut m = MessageWriter::new(&mut buf, W).unwrap();
        net.writer.transmit(net.now, &mut m).unwrap();
        let reader = &mut net.readers[at];
        for part in Message::decode(m.message())
            .unwrap()
            .submessages()
            .flatten()
        {
            if let Submessage::Reference(body) = part {
                reader.reference(W, &body, None);
                reader.reference(W, &body, None);
            }
        }
        let mut fetch = reader.fetch().unwrap();
        assert!(reader.fetch().is_none(), "a sample that came again is one");
        assert!(reader.remove_writer(own));
        net.memory.read(&mut fetch);
        reader.fetched(fetch, true, false);
        assert!(reader.take().is_none());
        let qos = *net.writer.qos();
        reader.add_writer(own, &qos, address(99));
        reader.offer(own, Some(NAME));
        reader.segment_opened(own, true);
    }
    net.write(9, 90_000).unwrap();
    assert_eq!(net.read(at, 1).last(), Some(&payload(9, 90_000)));
}

#[test]
fn a_best_effort_reader_takes_references_in_order() {
    let qos = Qos {
        reliability: Reliability::BestEffort,
        ..Qos::ros()
    };
    let mut net = Net::new(qos, 10, 1, 0);
    let at = net.join(10, Some(true));
    net.settle();
    for number in 0..20 {
        net.write(number, 90_000).unwrap();
        assert_eq!(net.read(at, 1), [payload(number, 90_000)]);
    }
    assert_eq!((net.sent.1, net.sent.2), (0, 20));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Every sample once and in order, whatever the link does and however many fetches fail.
    #[test]
    fn shared_samples_come_once_and_in_order(seed: u64, loss in 0..40u64, torn in 0..60u64, slots in 1..6usize,
                                             lens in prop::collection::vec(prop_oneof![0..64usize, 1000..20_000usize], 1..30)) {
        let mut net = Net::new(KEEP_ALL, slots, seed, loss);
        net.torn = torn;
        let at = net.join(slots, Some(true));
        let (mut got, mut next) = (Vec::new(), 0);
        let lens: Vec<_> = lens.iter().map(|len| len.next_multiple_of(4)).collect();
        for _ in 0..100_000 {
            while let Some(len) = lens.get(next) {
                match net.write(next as u32, *len) {
                    Ok(()) => next += 1,
                    Err(error) => { assert_eq!(error, WriteError::Full); break; }
                }
            }
            net.step();
            while let Some(sample) = net.readers[at].take() { got.push(sample.payload.to_vec()); }
            if got.len() == lens.len() && net.writer.is_acknowledged() { break; }
        }
        let sent: Vec<_> = lens.iter().enumerate().map(|(i, len)| payload(i as u32, *len)).collect();
        prop_assert_eq!(got.len(), sent.len(), "at {} ms", net.now / MILLI);
        prop_assert!(got == sent);
        prop_assert_eq!(net.stats(at).lost, 0);
    }
}
