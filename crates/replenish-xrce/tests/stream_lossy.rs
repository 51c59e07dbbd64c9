//! The two reliable stream machines against each other over a link that loses, duplicates, delays
//! and reorders, in virtual time: everything arrives exactly once, in order, for every seed.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use replenish_xrce::stream::{
    InputReliable, OutputReliable, OutputStats, PushError, Reliability, StreamHeader, Tail,
};
use replenish_xrce::wire::{
    BaseRequest, Body, ClientKey, Encode, Message, MessageWriter, ObjectId, ObjectKind, RequestId,
    SessionId, StreamId, WriteData,
};
use replenish_xrce::{Nanos, SeqNum};

const MTU: usize = 512;
const MILLI: Nanos = 1_000_000;

/// `SplitMix64`: the same seed gives the same trace.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: u64) -> u64 {
        self.next() % n
    }

    fn percent(&mut self, p: u64) -> bool {
        self.below(100) < p
    }
}

#[derive(Clone, Copy)]
struct Link {
    loss: u64,
    duplicates: u64,
    delay_min: Nanos,
    delay_max: Nanos,
}

#[derive(PartialEq, Eq, PartialOrd, Ord, Clone, Copy, Debug)]
enum To {
    Receiver,
    Sender,
}

/// Arrival time, then order of sending, destination, bytes.
type Flight = (Nanos, u64, To, Vec<u8>);

/// What is under way.
#[derive(Default)]
struct Air {
    heap: BinaryHeap<Reverse<Flight>>,
    count: u64,
    lost_data: u64,
}

impl Air {
    fn send(&mut self, now: Nanos, link: &Link, random: &mut Random, to: To, bytes: &[u8]) {
        let copies = if random.percent(link.loss) {
            self.lost_data += u64::from(to == To::Receiver);
            0
        } else {
            1 + u64::from(random.percent(link.duplicates))
        };
        for _ in 0..copies {
            let at = now + link.delay_min + random.below(link.delay_max - link.delay_min + 1);
            self.count += 1;
            self.heap
                .push(Reverse((at, self.count, to, bytes.to_vec())));
        }
    }
}

/// Shortest and longest sample in bytes.
type Sizes = (usize, usize);

/// Sample `i`: its number and a pattern, of a length that depends on the number.
fn payload(i: u32, (shortest, longest): Sizes) -> Vec<u8> {
    let len = match i % 50 {
        7 => longest,
        8 => longest.min(3000),
        r => shortest + r as usize,
    };
    let mut payload: Vec<u8> = (0..len)
        .map(|at| (at as u32).wrapping_mul(i | 1) as u8)
        .collect();
    payload[..4].copy_from_slice(&i.to_le_bytes());
    payload
}

struct Outcome {
    stats: OutputStats,
    lost_data: u64,
    /// A digest of everything that was sent and when.
    trace: u64,
    seconds: f64,
}

fn run(seed: u64, link: Link, samples: u32, sizes: Sizes) -> Outcome {
    let header = StreamHeader {
        session: SessionId(0x81),
        stream: StreamId::RELIABLE,
        key: ClientKey([1; 4]),
    };
    let mut output: OutputReliable<_, 128> = OutputReliable::new(
        vec![0; 128 * MTU],
        MTU,
        header,
        Tail::Padded,
        Reliability::default(),
    );
    let mut input: InputReliable<_, _, 16> =
        InputReliable::new(StreamId::RELIABLE, vec![0; 16 * MTU], MTU, vec![0; 66_000]);
    let mut random = Random(seed);
    let (mut air, mut now, mut trace) = (Air::default(), 0, seed);
    let (mut pushed, mut delivered) = (0_u32, 0_u32);
    let object = ObjectId::new(1, ObjectKind::DataWriter);

    while delivered < samples || !output.is_idle() {
        // The writer: as much as the stream takes.
        while pushed < samples {
            let payload = payload(pushed, sizes);
            let base = BaseRequest {
                request: RequestId::FIRST,
                object,
            };
            match output.push(&WriteData {
                base,
                payload: &payload,
            }) {
                Ok(()) => pushed += 1,
                Err(PushError::WouldBlock) => break,
                Err(error) => panic!("sample {pushed}: {error}"),
            }
        }
        let mut note = |now: Nanos, bytes: &[u8]| {
            for &byte in now.to_le_bytes().iter().chain(bytes) {
                trace = (trace ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            }
        };
        while let Some(bytes) = output.next_datagram(now) {
            note(now, bytes);
            air.send(now, &link, &mut random, To::Receiver, bytes);
        }
        if let Some(heartbeat) = output.take_heartbeat(now) {
            let mut buf = [0; 32];
            let bytes = outside(&heartbeat, &mut buf);
            note(now, bytes);
            air.send(now, &link, &mut random, To::Receiver, bytes);
        }
        // The next event: an arrival or a timer.
        let arrival = air.heap.peek().map(|Reverse(event)| event.0);
        let timer = output.next_deadline();
        assert!(
            arrival.or(timer).is_some(),
            "stuck at {now} ns, {delivered} delivered"
        );
        now = now.max(arrival.into_iter().chain(timer).min().unwrap());
        if arrival.is_none_or(|arrival| arrival > now) {
            continue;
        }
        let Reverse((_, _, to, bytes)) = air.heap.pop().unwrap();
        let message = Message::parse(&bytes).unwrap();
        match to {
            To::Receiver if message.header.stream == StreamId::RELIABLE => {
                input.receive(message.header.seq, message.body, |submessage| {
                    let Ok(Body::WriteData(data)) = submessage.body() else {
                        panic!("not a sample: {submessage:?}");
                    };
                    // The last submessage of fragments has its padding outside of its length.
                    assert_eq!(
                        data.payload,
                        payload(delivered, sizes),
                        "sample {delivered}"
                    );
                    delivered += 1;
                });
            }
            _ => {
                for submessage in message.submessages() {
                    match submessage.unwrap().body().unwrap() {
                        Body::Heartbeat(heartbeat) => input.heartbeat(heartbeat.last),
                        Body::AckNack(ack) => {
                            output.acknowledge(now, ack.first_unacked, ack.missing);
                        }
                        other => panic!("unexpected {other:?}"),
                    }
                }
            }
        }
        if let Some(ack) = input.take_ack() {
            let mut buf = [0; 32];
            let bytes = outside(&ack, &mut buf);
            note(now, bytes);
            air.send(now, &link, &mut random, To::Sender, bytes);
        }
    }
    assert_eq!((pushed, delivered), (samples, samples));
    Outcome {
        stats: output.stats(),
        lost_data: air.lost_data,
        trace,
        seconds: now as f64 / 1e9,
    }
}

fn outside<'a>(body: &impl Encode, buf: &'a mut [u8]) -> &'a [u8] {
    let header = StreamHeader {
        session: SessionId(0x81),
        stream: StreamId::NONE,
        key: ClientKey([1; 4]),
    };
    let mut writer = MessageWriter::new(buf, &header.at(SeqNum(0))).unwrap();
    writer.push(body).unwrap();
    writer.finish()
}

#[test]
fn everything_arrives_once_and_in_order_whatever_the_link_does() {
    for loss in [0, 1, 10, 30] {
        for seed in 0..5 {
            let link = Link {
                loss,
                duplicates: 5,
                delay_min: MILLI,
                delay_max: 50 * MILLI,
            };
            let outcome = run(seed, link, 2_000, (4, 5_000));
            println!(
                "loss {loss} %, seed {seed}: {:?}, {} datagrams lost, {:.1} s",
                outcome.stats, outcome.lost_data, outcome.seconds
            );
        }
    }
}

#[test]
fn a_hundred_thousand_messages_over_a_bad_link() {
    let link = Link {
        loss: 10,
        duplicates: 2,
        delay_min: MILLI,
        delay_max: 2 * MILLI,
    };
    // No two samples fit into one message, so that the numbers wrap.
    let outcome = run(42, link, 100_000, (250, 700));
    assert!(outcome.stats.sent > 65_536, "{:?}", outcome.stats);
}

#[test]
fn fragments_of_fifty_kilobytes() {
    let link = Link {
        loss: 10,
        duplicates: 5,
        delay_min: MILLI,
        delay_max: 10 * MILLI,
    };
    run(7, link, 500, (4, 50_000));
}

#[test]
fn the_same_seed_gives_the_same_trace() {
    let link = Link {
        loss: 20,
        duplicates: 5,
        delay_min: MILLI,
        delay_max: 9 * MILLI,
    };
    let trace = |seed| run(seed, link, 500, (4, 2_000)).trace;
    assert_eq!(trace(1), trace(1));
    assert_ne!(trace(1), trace(2));
}

#[test]
fn only_what_was_lost_is_sent_again() {
    // Steady delay, so that every gap is a loss.
    for loss in [1, 10] {
        let link = Link {
            loss,
            duplicates: 0,
            delay_min: 5 * MILLI,
            delay_max: 5 * MILLI,
        };
        let outcome = run(3, link, 20_000, (4, 600));
        let OutputStats { resent, sent, .. } = outcome.stats;
        println!("{:?}, {} lost", outcome.stats, outcome.lost_data);
        // `lost_data` includes lost heartbeats and lost retransmissions.
        assert!(
            resent <= outcome.lost_data + sent / 100,
            "{resent} sent again, {} lost of {sent}",
            outcome.lost_data
        );
    }
    let clean = Link {
        loss: 0,
        duplicates: 0,
        delay_min: 5 * MILLI,
        delay_max: 5 * MILLI,
    };
    assert_eq!(run(3, clean, 20_000, (4, 600)).stats.resent, 0);
}
