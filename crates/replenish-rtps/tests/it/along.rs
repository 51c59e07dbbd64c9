//! Heartbeats and acknowledgements go along with samples: two participants in virtual time, one of
//! which answers the other's samples.

use crate::lossy::Dice;
use replenish_rtps::participant::{
    EndpointSpec, Participant, ParticipantConfig, ReaderId, WriterId,
};
use replenish_rtps::wire::{CDR_LE, EntityId, GuidPrefix, Message, Nanos, Qos, Submessage};
use std::net::SocketAddr;

const MILLI: Nanos = 1_000_000;

/// User datagrams of one node since the last look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Sent {
    /// With a sample.
    samples: u32,
    /// With a sample and a heartbeat, with a sample and an answer.
    heartbeats_along: u32,
    answers_along: u32,
    /// Without a sample.
    heartbeats_alone: u32,
    answers_alone: u32,
}

struct Node {
    participant: Participant,
    writer: WriterId,
    reader: ReaderId,
    /// Where the participant and its reader are reached.
    addresses: [SocketAddr; 2],
    sent: Sent,
    got: Vec<u32>,
}

impl Node {
    /// The node `at`; its reader has an address of its own if `apart`.
    fn new(at: u16, first_byte: u8, apart: bool, qos: Qos) -> Self {
        let address = |port| SocketAddr::from(([127, 0, 0, 1], port));
        let own = address(8000 + 2 * at);
        let other = if apart { address(8001 + 2 * at) } else { own };
        let mut prefix = [first_byte; 12];
        prefix[11] = at as u8 + 1;
        let config = ParticipantConfig {
            discovery: [own].into_iter().collect(),
            user: [own].into_iter().collect(),
            announce_to: &[address(8000), address(8002)],
            ..ParticipantConfig::new(GuidPrefix(prefix))
        };
        let mut participant = Participant::new(&config, 0).unwrap();
        let topics = if at == 0 {
            ["rt/there", "rt/back"]
        } else {
            ["rt/back", "rt/there"]
        };
        let spec = |topic| EndpointSpec {
            qos,
            sample_bytes: 8,
            samples: 400,
            ..EndpointSpec::new(topic, "std_msgs::msg::dds_::Int32_")
        };
        let writer = participant.create_writer(&spec(topics[0]), 0).unwrap();
        let spec = EndpointSpec {
            unicast: [other].into_iter().collect(),
            ..spec(topics[1])
        };
        let reader = participant.create_reader(&spec, 0).unwrap();
        Node {
            participant,
            writer,
            reader,
            addresses: [own, other],
            sent: Sent::default(),
            got: Vec::new(),
        }
    }

    fn count(&mut self, datagram: &[u8]) {
        let (mut samples, mut heartbeats, mut answers) = (0, 0, 0);
        for part in Message::decode(datagram).unwrap().submessages() {
            match part.unwrap() {
                Submessage::Data(data) if is_user(data.writer) => samples += 1,
                Submessage::Heartbeat(body) if is_user(body.writer) => heartbeats += 1,
                Submessage::AckNack(body) if is_user(body.writer) => answers += 1,
                _ => {}
            }
        }
        let along = samples > 0;
        self.sent.samples += samples;
        let Sent {
            heartbeats_along,
            heartbeats_alone,
            answers_along,
            answers_alone,
            ..
        } = &mut self.sent;
        *(if along {
            heartbeats_along
        } else {
            heartbeats_alone
        }) += u32::from(heartbeats > 0);
        *(if along { answers_along } else { answers_alone }) += u32::from(answers > 0);
    }
}

/// Endpoints of discovery have kinds of their own.
fn is_user(entity: EntityId) -> bool {
    entity.0[3] & 0xc0 == 0
}

struct Net {
    nodes: [Node; 2],
    now: Nanos,
    loss: u64,
    dice: Dice,
}

impl Net {
    /// Two nodes that know each other.
    fn new(first_byte: u8, apart: bool, qos: Qos) -> Self {
        let node = |at| Node::new(at, first_byte, apart, qos);
        let mut net = Net {
            nodes: [node(0), node(1)],
            now: 0,
            loss: 0,
            dice: Dice(99),
        };
        net.run(1000 * MILLI, false);
        for node in &net.nodes {
            let matched = node.participant.writer(node.writer).unwrap().matched();
            assert_eq!(matched, 1);
        }
        net.take();
        net
    }

    fn take(&mut self) -> [Sent; 2] {
        self.nodes
            .each_mut()
            .map(|node| std::mem::take(&mut node.sent))
    }

    fn write(&mut self, at: usize, number: u32) -> bool {
        let sample = [CDR_LE, number.to_le_bytes()].concat();
        let node = &mut self.nodes[at];
        node.participant
            .write(node.writer, &sample, None, self.now)
            .is_ok()
    }

    /// Runs for a while; with `echo` node 1 sends each sample back.
    fn run(&mut self, time: Nanos, echo: bool) {
        let end = self.now + time;
        loop {
            while self.exchange(echo) {}
            if self.now >= end {
                return;
            }
            let next = self
                .nodes
                .iter()
                .map(|node| node.participant.next_at(self.now));
            self.now = next.min().unwrap_or(end).clamp(self.now + 1, end);
        }
    }

    fn exchange(&mut self, echo: bool) -> bool {
        let (mut any, mut buf) = (false, [0; 1472]);
        for from in 0..2 {
            while let Some((len, to)) = self.nodes[from].participant.transmit(&mut buf, self.now) {
                any = true;
                self.nodes[from].count(&buf[..len]);
                for node in &mut self.nodes {
                    let lost = self.dice.roll(100) < self.loss;
                    if node.addresses.contains(&to) && !lost {
                        node.participant.receive(&buf[..len], self.now).unwrap();
                    }
                }
            }
            let node = &mut self.nodes[1 - from];
            let mut came = Vec::new();
            while let Some(sample) = node.participant.take(node.reader) {
                came.push(u32::from_le_bytes(sample.payload[4..8].try_into().unwrap()));
            }
            node.got.extend(&came);
            if echo && from == 0 {
                came.into_iter()
                    .for_each(|number| assert!(self.write(1, number)));
            }
        }
        any
    }

    fn is_acknowledged(&self, at: usize) -> bool {
        let node = &self.nodes[at];
        node.participant
            .writer(node.writer)
            .unwrap()
            .is_acknowledged()
    }
}

/// A stream of a thousand a second: a tenth of the samples bear a heartbeat. They are answered at
/// once, since no samples go back.
#[test]
fn a_stream_takes_its_heartbeats_along() {
    let mut net = Net::new(0, true, Qos::ros());
    for number in 0..100 {
        assert!(net.write(0, number));
        net.run(MILLI, false);
    }
    let sent = net.take();
    let along = sent[0].heartbeats_along;
    assert_eq!((sent[0].samples, sent[0].heartbeats_alone), (100, 0));
    assert!((9..=11).contains(&along), "{along}");
    assert_eq!((sent[1].answers_alone, sent[1].answers_along), (along, 0));
    // The last samples are announced alone, as nothing follows them.
    net.run(20 * MILLI, false);
    assert!(net.is_acknowledged(0));
    assert!(net.take()[0].heartbeats_alone <= 1);
    assert_eq!(net.nodes[1].got, (0..100).collect::<Vec<_>>());
}

/// A sample that comes seldom bears its heartbeat, and its acknowledgement ends the exchange.
#[test]
fn a_seldom_sample_costs_two_datagrams() {
    let mut net = Net::new(0, true, Qos::ros());
    for number in 0..10 {
        assert!(net.write(0, number));
        net.run(100 * MILLI, false);
        assert!(net.is_acknowledged(0));
    }
    let [writer, reader] = net.take();
    assert_eq!(
        (
            writer.samples,
            writer.heartbeats_along,
            writer.heartbeats_alone
        ),
        (10, 10, 0)
    );
    assert_eq!((reader.answers_alone, reader.answers_along), (10, 0));
}

/// Samples that go back take the answers along: to another implementation if they have the same
/// address, within this library to any.
#[test]
fn samples_that_go_back_take_answers_along() {
    for (first_byte, apart, joins) in [
        (0, false, true),
        (0, true, true),
        (1, false, true),
        (1, true, false),
    ] {
        let mut net = Net::new(first_byte, apart, Qos::ros());
        for number in 0..100 {
            assert!(net.write(0, number));
            net.run(MILLI, true);
        }
        for (at, sent) in net.take().into_iter().enumerate() {
            let case = format!("{first_byte} {apart} {at} {sent:?}");
            // The first heartbeat finds no sample that went back before.
            let alone = sent.answers_alone;
            assert_eq!((sent.samples, sent.heartbeats_alone), (100, 0), "{case}");
            assert!((9..=11).contains(&(sent.answers_along + alone)), "{case}");
            assert!(
                if joins {
                    alone <= 1
                } else {
                    sent.answers_along == 0
                },
                "{case}"
            );
        }
        // An answer that no sample takes along goes alone.
        net.run(20 * MILLI, true);
        assert!(net.is_acknowledged(0) && net.is_acknowledged(1));
    }
}

/// With loss both ways each sample comes once and in order, though answers are lost with samples.
#[test]
fn a_lossy_conversation_loses_nothing() {
    let qos = Qos {
        depth: 0,
        ..Qos::ros()
    };
    for (seed, loss) in [(1, 5), (2, 20), (3, 40)] {
        let mut net = Net::new(0, true, qos);
        (net.loss, net.dice) = (loss, Dice(seed));
        let mut next = 0;
        while next < 300 {
            if net.write(0, next) {
                next += 1;
            }
            net.run(MILLI, true);
        }
        net.run(30_000 * MILLI, true);
        let all: Vec<_> = (0..300).collect();
        assert_eq!(net.nodes[1].got, all, "{loss} %");
        assert!(net.is_acknowledged(0) && net.is_acknowledged(1), "{loss} %");
        assert_eq!(net.nodes[0].got, all, "{loss} %");
    }
}
