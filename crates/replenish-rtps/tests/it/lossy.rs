//! A writer and a reader over a bad link, in virtual time: loss, duplicates, reordering.

use proptest::prelude::*;
use replenish_rtps::endpoint::{
    HostLimits, Reader, ReaderLimits, WriteError, Writer, WriterLimits,
};
use replenish_rtps::wire::{
    AckNack, CDR_LE, Data, EntityId, Guid, GuidPrefix, Heartbeat, Message, MessageWriter, Nanos,
    Payload, Qos, Reliability, SequenceSet, Submessage,
};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::net::SocketAddr;

pub(crate) const MILLI: Nanos = 1_000_000;
/// Fragments are as short as to other hosts.
pub(crate) const HOST: HostLimits = HostLimits {
    fragment_bytes: 700,
    ..HostLimits::DEFAULT
};
pub(crate) const W: GuidPrefix = GuidPrefix([1; 12]);
const R: GuidPrefix = GuidPrefix([2; 12]);

/// Xorshift: the same seed, the same link.
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    pub(crate) fn roll(&mut self, sides: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % sides
    }
}

/// A datagram under way: when, which one (for a stable order), to which end, its bytes.
type Flying<T> = Reverse<(Nanos, u64, T, Vec<u8>)>;

/// A link between ends of type `T`.
pub(crate) struct Link<T> {
    dice: Dice,
    loss: u64,
    flying: BinaryHeap<Flying<T>>,
    sent: u64,
}

impl<T: Ord + Copy> Link<T> {
    pub(crate) fn new(seed: u64, loss: u64) -> Self {
        Self {
            dice: Dice(seed | 1),
            loss,
            flying: BinaryHeap::new(),
            sent: 0,
        }
    }

    /// Loses one in so many of a hundred, sends one in ten twice, and delays each by up to 5 ms.
    pub(crate) fn send(&mut self, now: Nanos, to: T, bytes: &[u8]) {
        let copies = u64::from(self.dice.roll(100) < 10) + 1;
        for _ in 0..copies {
            self.sent += 1;
            if self.dice.roll(100) >= self.loss {
                let delay = self.dice.roll(5 * MILLI);
                let bytes = bytes.to_vec();
                self.flying
                    .push(Reverse((now + delay, self.sent, to, bytes)));
            }
        }
    }

    /// The time at which the next datagram arrives.
    pub(crate) fn next_at(&self) -> Nanos {
        self.flying.peek().map_or(Nanos::MAX, |next| next.0.0)
    }

    /// A datagram that has arrived by `now`.
    pub(crate) fn arrived(&mut self, now: Nanos) -> Option<(T, Vec<u8>)> {
        if self.next_at() > now {
            return None;
        }
        let Reverse((_, _, to, bytes)) = self.flying.pop()?;
        Some((to, bytes))
    }
}

struct Pair {
    writer: Writer,
    reader: Reader,
    /// True: to the reader.
    link: Link<bool>,
    now: Nanos,
}

pub(crate) fn payload(number: u32, len: usize) -> Vec<u8> {
    let body = (0..len).map(|i| (i as u32).wrapping_mul(number) as u8);
    CDR_LE
        .into_iter()
        .chain(number.to_le_bytes())
        .chain(body)
        .collect()
}

impl Pair {
    fn new(qos: Qos, slots: usize, seed: u64, loss: u64) -> Self {
        let (w, r) = (
            Guid::new(W, EntityId::writer(1)),
            Guid::new(R, EntityId::reader(1)),
        );
        let limits = WriterLimits {
            samples: slots,
            sample_bytes: 8192,
            readers: 2,
            fragment_bytes: 700,
            memory: None,
            host: HOST,
        };
        let room = ReaderLimits {
            samples: slots,
            sample_bytes: 8192,
            writers: 2,
        };
        let mut pair = Pair {
            writer: Writer::new(w, qos, &limits),
            reader: Reader::new(r, qos, &room),
            link: Link::new(seed, loss),
            now: 1,
        };
        pair.connect();
        pair
    }

    fn connect(&mut self) {
        let to: SocketAddr = "127.0.0.1:1".parse().unwrap();
        let (qos, guid) = (*self.reader.qos(), self.reader.guid());
        assert!(self.writer.add_reader(guid, &qos, to, self.now));
        let (qos, guid) = (*self.writer.qos(), self.writer.guid());
        assert!(self.reader.add_writer(guid, &qos, to));
    }

    /// Sends what there is, moves on to the next event, delivers.
    fn step(&mut self) {
        let mut buf = [0; 1472];
        loop {
            let mut m = MessageWriter::new(&mut buf, W).unwrap();
            if self.writer.transmit(self.now, &mut m).is_none() {
                break;
            }
            let bytes = m.message().to_vec();
            self.link.send(self.now, true, &bytes);
        }
        while self.reader.wants_to_transmit(self.now) {
            let mut m = MessageWriter::new(&mut buf, R).unwrap();
            self.reader.transmit(self.now, &mut m).unwrap();
            let bytes = m.message().to_vec();
            self.link.send(self.now, false, &bytes);
        }
        let timer = self.writer.next_at(self.now);
        assert!(timer > self.now, "nothing is left to send, yet it wants to");
        let next = timer.min(self.link.next_at());
        self.now = next.min(self.now + 1000 * MILLI);
        while let Some((to_reader, bytes)) = self.link.arrived(self.now) {
            self.deliver(to_reader, &bytes);
        }
    }

    fn deliver(&mut self, to_reader: bool, bytes: &[u8]) {
        let message = Message::decode(bytes).unwrap();
        for part in message.submessages() {
            match part.unwrap() {
                Submessage::Data(data) if to_reader => self.reader.data(W, &data, None),
                Submessage::DataFrag(data) if to_reader => self.reader.data_frag(W, &data, None),
                Submessage::Heartbeat(body) if to_reader => self.reader.heartbeat(W, &body),
                Submessage::Gap(body) if to_reader => self.reader.gap(W, &body),
                Submessage::AckNack(body) => {
                    self.writer.acknack(R, &body, self.now);
                }
                Submessage::NackFrag(body) => self.writer.nack_frag(R, &body, self.now),
                _ => {}
            }
        }
    }

    fn read(&mut self, got: &mut Vec<Vec<u8>>) {
        while let Some(sample) = self.reader.take() {
            got.push(sample.payload.to_vec());
        }
    }
}

pub(crate) const KEEP_ALL: Qos = Qos {
    depth: 0,
    ..Qos::ros()
};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The promise of reliability: every sample once, in order, whatever the link does, short
    /// samples and fragments mixed.
    #[test]
    fn reliable_samples_come_once_and_in_order(seed: u64, loss in 0..40u64, slots in 1..9usize,
                                               lens in prop::collection::vec(prop_oneof![0..64usize, 0..8000usize], 1..40)) {
        let mut pair = Pair::new(KEEP_ALL, slots, seed, loss);
        let (mut got, mut next) = (Vec::new(), 0);
        for _ in 0..200_000 {
            while let Some(len) = lens.get(next) {
                let sample = payload(next as u32, len.next_multiple_of(4));
                match pair.writer.write(&sample, None, pair.now) {
                    Ok(_) => next += 1,
                    Err(error) => { assert_eq!(error, WriteError::Full); break; }
                }
            }
            pair.step();
            pair.read(&mut got);
            if got.len() == lens.len() && pair.writer.is_acknowledged() { break; }
        }
        let sent: Vec<_> = lens.iter().enumerate()
            .map(|(i, len)| payload(i as u32, len.next_multiple_of(4))).collect();
        prop_assert_eq!(got.len(), sent.len(), "at {} ms", pair.now / MILLI);
        prop_assert!(got == sent);
        prop_assert!(pair.writer.is_acknowledged());
        prop_assert_eq!(pair.reader.stats().lost, 0);
    }

    /// With the last ones kept, what arrives is in order and once, and the last one always comes.
    #[test]
    fn keep_last_loses_only_the_older_ones(seed: u64, loss in 0..40u64, depth in 1..6u32, count in 1..60u32) {
        let qos = Qos { depth, ..Qos::ros() };
        let mut pair = Pair::new(qos, depth as usize, seed, loss);
        let mut got = Vec::new();
        for number in 0..count {
            pair.writer.write(&payload(number, 8), None, pair.now).unwrap();
            if seed.wrapping_mul(u64::from(number)) % 3 == 0 { pair.step(); pair.read(&mut got); }
        }
        for _ in 0..5_000 {
            pair.step();
            pair.read(&mut got);
            if pair.writer.is_acknowledged() { break; }
        }
        prop_assert!(pair.writer.is_acknowledged());
        let numbers: Vec<u32> = got.iter().map(|b| u32::from_le_bytes(b[4..8].try_into().unwrap())).collect();
        prop_assert!(numbers.windows(2).all(|two| two[0] < two[1]), "{numbers:?}");
        prop_assert_eq!(numbers.last().copied(), Some(count - 1));
    }

    /// Best effort: never twice, never backwards, never a damaged one.
    #[test]
    fn best_effort_samples_come_at_most_once(seed: u64, loss in 0..40u64, count in 1..40u32, len in 0..3000usize) {
        let qos = Qos { reliability: Reliability::BestEffort, depth: 5, ..Qos::ros() };
        let mut pair = Pair::new(qos, 5, seed, loss);
        let len = len.next_multiple_of(4);
        let mut got = Vec::new();
        for number in 0..count {
            pair.writer.write(&payload(number, len), None, pair.now).unwrap();
            pair.step();
            pair.read(&mut got);
        }
        for _ in 0..200 { pair.step(); pair.read(&mut got); }
        let numbers: Vec<u32> = got.iter().map(|b| u32::from_le_bytes(b[4..8].try_into().unwrap())).collect();
        prop_assert!(numbers.windows(2).all(|two| two[0] < two[1]), "{numbers:?}");
        for (number, bytes) in numbers.iter().zip(&got) {
            prop_assert!(*bytes == payload(*number, len));
        }
        prop_assert!(loss > 0 || len > 700 || numbers.len() as u32 + pair.reader.stats().duplicates as u32 > 0);
    }

    /// A reader that lost its writer for a while, which did not lose the reader, takes no sample
    /// twice and misses none.
    #[test]
    fn a_writer_that_comes_back_goes_on_where_it_was(seed: u64, loss in 0..30u64, away in 1..6usize) {
        let qos = Qos { depth: 0, ..Qos::ros() };
        let mut pair = Pair::new(qos, 32, seed, loss);
        let (own, to) = (pair.writer.guid(), "127.0.0.1:1".parse().unwrap());
        let mut got = Vec::new();
        for number in 0..30 {
            if number % 10 == 5 {
                pair.reader.remove_writer(own);
            }
            pair.writer.write(&payload(number, 8), None, pair.now).unwrap();
            for _ in 0..away { pair.step(); pair.read(&mut got); }
            if number % 10 == 8 {
                // A lease is longer than any datagram is under way.
                let end = pair.now + 10 * MILLI;
                while pair.now < end { pair.step(); pair.read(&mut got); }
                let qos = *pair.writer.qos();
                prop_assert!(pair.reader.add_writer(own, &qos, to));
            }
        }
        for _ in 0..400 { pair.step(); pair.read(&mut got); }
        let numbers: Vec<u32> = got.iter().map(|b| u32::from_le_bytes(b[4..8].try_into().unwrap())).collect();
        prop_assert_eq!(numbers, (0..30).collect::<Vec<_>>());
    }

    /// Transient local: a reader that comes late has the last ones; a volatile one has none.
    #[test]
    fn late_readers_get_what_durability_says(seed: u64, loss in 0..30u64, depth in 1..6u32, count in 1..20u32, latched: bool) {
        let qos = if latched { Qos::latched(depth) } else { Qos { depth, ..Qos::ros() } };
        let mut pair = Pair::new(qos, 8, seed, loss);
        let guid = pair.reader.guid();
        pair.writer.remove_reader(guid);
        let own = pair.writer.guid();
        pair.reader.remove_writer(own);
        pair.writer = Writer::new(own, qos, &WriterLimits {
            samples: depth as usize, sample_bytes: 64, readers: 1, fragment_bytes: 700, host: HOST,
            memory: None,
        });
        for number in 0..count {
            pair.writer.write(&payload(number, 8), None, pair.now).unwrap();
        }
        pair.connect();
        let mut got = Vec::new();
        for _ in 0..300 { pair.step(); pair.read(&mut got); }
        pair.writer.write(&payload(count, 8), None, pair.now).unwrap();
        for _ in 0..300 { pair.step(); pair.read(&mut got); }
        let numbers: Vec<u32> = got.iter().map(|b| u32::from_le_bytes(b[4..8].try_into().unwrap())).collect();
        let first = if latched { count.saturating_sub(depth) } else { count };
        prop_assert_eq!(numbers, (first..=count).collect::<Vec<_>>());
    }
}

/// A late reader of a volatile writer was promised nothing from before the match. It counts what
/// the writer drops afterwards, and nothing else.
#[test]
fn a_late_reader_does_not_count_samples_from_before_the_match() {
    let qos = Qos {
        depth: 4,
        ..Qos::ros()
    };
    let heartbeat = |first, last, count| Heartbeat {
        reader: EntityId::default(),
        writer: EntityId::writer(1),
        first,
        last,
        count,
        final_flag: false,
        liveliness: false,
    };
    let data = |sn, payload| Data {
        reader: EntityId::default(),
        writer: EntityId::writer(1),
        sn,
        inline_qos: None,
        payload: Payload::Data(payload),
    };
    let payload = payload(1, 4);
    let to: SocketAddr = "127.0.0.1:1".parse().unwrap();
    let late = || {
        let room = ReaderLimits {
            samples: 8,
            sample_bytes: 64,
            writers: 1,
        };
        let mut reader = Reader::new(Guid::new(R, EntityId::reader(1)), qos, &room);
        let writer = Guid::new(W, EntityId::writer(1));
        assert!(reader.add_writer(writer, &qos, to));
        reader
    };
    // A sample is the first thing that it hears.
    let mut reader = late();
    reader.data(W, &data(57, &payload), None);
    reader.heartbeat(W, &heartbeat(54, 57, 1));
    assert_eq!(reader.stats().lost, 0);
    // 58 and 59 were written after the match and are gone.
    reader.heartbeat(W, &heartbeat(60, 63, 2));
    assert_eq!((reader.stats().received, reader.stats().lost), (1, 2));
    // A heartbeat is: the fate of the samples up to its last is unknown.
    let mut reader = late();
    reader.heartbeat(W, &heartbeat(1, 56, 1));
    reader.heartbeat(W, &heartbeat(53, 56, 2));
    assert_eq!(reader.stats().lost, 0);
    reader.heartbeat(W, &heartbeat(60, 63, 3));
    assert_eq!(reader.stats().lost, 3);
}

/// A reader that lost the writer for a while counts its ACKNACKs from the beginning, and gets what
/// it asks for again.
#[test]
fn a_reader_that_begins_anew_is_served() {
    let mut pair = Pair::new(Qos::latched(4), 4, 1, 0);
    for number in 1..=3 {
        let sample = payload(number, 4);
        pair.writer.write(&sample, None, pair.now).unwrap();
    }
    for _ in 0..200 {
        pair.step();
    }
    assert!(pair.writer.is_acknowledged());
    let mut state = SequenceSet::empty(1);
    for sn in 1..=3 {
        state.insert(sn);
    }
    let ask = |state, count| AckNack {
        reader: EntityId::reader(1),
        writer: EntityId::writer(1),
        state,
        count,
        final_flag: false,
    };
    let sent = |pair: &mut Pair| {
        let (mut buf, mut samples) = ([0; 1472], 0);
        loop {
            let mut m = MessageWriter::new(&mut buf, W).unwrap();
            if pair.writer.transmit(pair.now, &mut m).is_none() {
                break samples;
            }
            let message = Message::decode(m.message()).unwrap();
            let data = |part: &Result<Submessage<'_>, _>| matches!(part, Ok(Submessage::Data(_)));
            samples += message.submessages().filter(data).count();
        }
    };
    assert_eq!(sent(&mut pair), 0);
    assert!(pair.writer.acknack(R, &ask(state, 1), pair.now));
    assert_eq!(sent(&mut pair), 3);
    // One that has everything is not new.
    assert!(
        !pair
            .writer
            .acknack(R, &ask(SequenceSet::empty(4), 2), pair.now)
    );
    assert_eq!(sent(&mut pair), 0);
}

/// Two heartbeats of a stranger say that a whole history was lost: nine such ended the program.
#[test]
fn counts_of_lost_samples_have_an_end() {
    let (qos, to) = (Qos::latched(1), "127.0.0.1:1".parse().unwrap());
    let limits = ReaderLimits {
        samples: 1,
        sample_bytes: 8,
        writers: 9,
    };
    let mut reader = Reader::new(Guid::new(R, EntityId::reader(1)), qos, &limits);
    for writer in (1..=9).map(EntityId::writer) {
        assert!(reader.add_writer(Guid::new(W, writer), &qos, to));
        for (count, first) in [(1, 1), (2, (1 << 61) - 1)] {
            let body = Heartbeat {
                reader: EntityId::UNKNOWN,
                writer,
                first,
                last: first - 1,
                count,
                final_flag: true,
                liveliness: false,
            };
            reader.heartbeat(W, &body);
        }
    }
    assert_eq!(reader.stats().lost, u64::MAX);
}

/// The acknowledgement that asks a new writer for a heartbeat gets lost.
#[test]
fn a_writer_that_was_not_heard_is_asked_again() {
    let limits = ReaderLimits {
        samples: 1,
        sample_bytes: 8,
        writers: 1,
    };
    let mut reader = Reader::new(Guid::new(R, EntityId::reader(1)), Qos::ros(), &limits);
    let writer = Guid::new(W, EntityId::writer(1));
    assert!(reader.add_writer(writer, &Qos::ros(), "127.0.0.1:1".parse().unwrap()));
    let (mut buf, mut asked) = ([0; 1472], 0);
    for now in (0..10_000).map(|ms| ms * MILLI) {
        let mut m = MessageWriter::new(&mut buf, R).unwrap();
        asked += usize::from(reader.transmit(now, &mut m).is_some());
    }
    assert_eq!(asked, 10);
    let body = Heartbeat {
        reader: EntityId::UNKNOWN,
        writer: writer.entity,
        first: 1,
        last: 0,
        count: 1,
        final_flag: false,
        liveliness: false,
    };
    reader.heartbeat(W, &body);
    for now in (10_000..20_000).map(|ms| ms * MILLI) {
        let mut m = MessageWriter::new(&mut buf, R).unwrap();
        asked += usize::from(reader.transmit(now, &mut m).is_some());
    }
    assert_eq!(asked, 11, "one answer to the heartbeat");
}
