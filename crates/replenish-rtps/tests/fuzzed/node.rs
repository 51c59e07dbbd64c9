//! A whole participant in virtual time, under a stranger's datagrams, beside an honest peer whose
//! samples all arrive once and in order.

use super::datagrams::{TOPIC, TYPE};
use super::decoders::NODES;
use replenish_rtps::participant::{
    EndpointSpec, Event, Limits, Participant, ParticipantConfig, ReaderId, WriterId,
};
use replenish_rtps::ros::{GRAPH_QOS, GRAPH_TOPIC, GRAPH_TYPE, KnownNodes};
use replenish_rtps::wire::{CDR_LE, EntityId, GuidPrefix, Nanos};
use std::net::SocketAddr;

const SECOND: Nanos = 1_000_000_000;
const LIMITS: Limits = Limits {
    participants: 6,
    endpoints: 12,
    own_endpoints: 4,
    matches: 4,
    events: 16,
};
/// Bytes of the longest sample.
const MOST: usize = 512;
pub(crate) const FIRED_AT: GuidPrefix = GuidPrefix([0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]);
const HONEST: GuidPrefix = GuidPrefix([0, 0, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2]);

struct Node {
    participant: Participant,
    writer: WriterId,
    reader: ReaderId,
}

fn address(prefix: GuidPrefix) -> SocketAddr {
    ([127, 0, 0, 1], 8000 + u16::from(prefix.0[11])).into()
}

fn node(prefix: GuidPrefix, other: GuidPrefix) -> Node {
    let config = ParticipantConfig {
        discovery: [address(prefix)].into_iter().collect(),
        user: [address(prefix)].into_iter().collect(),
        announce_to: &[address(other)],
        limits: LIMITS,
        ..ParticipantConfig::new(prefix)
    };
    let mut participant = Participant::new(&config, 1).unwrap();
    let spec = EndpointSpec {
        sample_bytes: MOST,
        ..EndpointSpec::new(TOPIC, TYPE)
    };
    participant.keep_apart();
    Node {
        writer: participant.create_writer(&spec, 1).unwrap(),
        reader: participant.create_reader(&spec, 1).unwrap(),
        participant,
    }
}

/// Sends all there is; `to`, which is reached at `addr`, gets its own. Whether there was any.
fn send(from: &mut Node, to: &mut Node, addr: SocketAddr, now: Nanos, buf: &mut [u8]) -> bool {
    let mut some = false;
    for datagram in 0.. {
        let Some((len, at)) = from.participant.transmit(buf, now) else {
            break;
        };
        assert!(datagram < 5000, "no end");
        if at == addr {
            to.participant.receive(&buf[..len], now).unwrap();
            some = true;
        }
    }
    some
}

/// The participant under fire, and its honest peer.
pub(crate) struct Pair {
    one: Node,
    two: Node,
    graph: ReaderId,
    known: KnownNodes,
    now: Nanos,
    sent: u32,
    came: u32,
    buf: Vec<u8>,
    /// Samples of strangers, messages about nodes, events, and matches among these.
    pub(crate) counts: [u64; 4],
}

impl Pair {
    pub(crate) fn new() -> Self {
        let (mut one, two) = (node(FIRED_AT, HONEST), node(HONEST, FIRED_AT));
        let spec = EndpointSpec {
            qos: GRAPH_QOS,
            sample_bytes: MOST,
            samples: 4,
            per_participant: true,
            ..EndpointSpec::new(GRAPH_TOPIC, GRAPH_TYPE)
        };
        let graph = one.participant.create_reader(&spec, 1).unwrap();
        let mut pair = Pair {
            one,
            two,
            graph,
            known: KnownNodes::new(NODES),
            now: 1,
            sent: 0,
            came: 0,
            buf: vec![0; 1472],
            counts: [0; 4],
        };
        for _ in 0..10 {
            pair.pass(SECOND / 20);
        }
        pair.honest();
        pair
    }

    /// The names at which strangers aim: of the writer, of its topic's reader, and of the graph's.
    pub(crate) const fn names(&self) -> (EntityId, [EntityId; 2]) {
        let readers = [self.one.reader.entity(), self.graph.entity()];
        (self.one.writer.entity(), readers)
    }

    /// A datagram of a stranger.
    pub(crate) fn receive(&mut self, datagram: &[u8]) {
        self.one.participant.receive(datagram, self.now).ok();
        self.exchange();
    }

    /// Time passes.
    pub(crate) fn pass(&mut self, time: Nanos) {
        self.now += time;
        self.exchange();
    }

    /// The honest peer sends a sample, and the participant under fire another, which both get.
    pub(crate) fn honest(&mut self) {
        self.sent += 1;
        let sample = [CDR_LE, self.sent.to_le_bytes()].concat();
        let two = &mut self.two;
        two.participant
            .write(two.writer, &sample, None, self.now)
            .unwrap();
        let one = &mut self.one;
        one.participant
            .write(one.writer, &sample, None, self.now)
            .unwrap();
        self.exchange();
        assert_eq!(self.came, self.sent, "an honest sample is there");
    }

    /// Each gets what the other sends to it; datagrams to strangers go nowhere.
    fn exchange(&mut self) {
        for round in 0.. {
            assert!(round < 100, "no end");
            self.fetch();
            let (now, buf) = (self.now, &mut self.buf);
            let there = send(&mut self.one, &mut self.two, address(HONEST), now, buf);
            let back = send(&mut self.two, &mut self.one, address(FIRED_AT), now, buf);
            self.take();
            if !there && !back {
                let next = self.one.participant.next_at(now);
                assert!(next > now, "nothing is left to send");
                return;
            }
        }
    }

    /// Half of the memories can be opened; some samples are not there, and some memories break.
    fn fetch(&mut self) {
        let one = &mut self.one.participant;
        while let Some((writer, name)) = one.wanted_segment() {
            one.segment_opened(writer, name.0[0] == 1);
        }
        while let Some(mut fetch) = one.fetch(None) {
            assert!(fetch.room().len() <= MOST && fetch.writer.prefix != HONEST);
            fetch.room().fill(7);
            let (whole, broken) = (fetch.place.slot % 2 == 0, fetch.place.slot % 16 == 1);
            one.fetched(fetch, whole, broken, self.now);
        }
    }

    fn take(&mut self) {
        let one = &mut self.one.participant;
        while let Some(sample) = one.take(self.one.reader) {
            assert!(sample.payload.len() <= MOST);
            if sample.writer.prefix == HONEST {
                self.came += 1;
                assert_eq!(
                    sample.payload[4..],
                    self.came.to_le_bytes(),
                    "once, in order"
                );
            } else {
                self.counts[0] += 1;
            }
        }
        while let Some(sample) = one.take(self.graph) {
            let from = sample.writer.prefix;
            self.counts[1] += u64::from(self.known.learn(from, sample.payload).is_ok());
        }
        while let Some(event) = one.event() {
            self.counts[2] += 1;
            self.counts[3] += u64::from(matches!(event, Event::Matched(..)));
            if let Event::ParticipantLost(gone) = event {
                self.known.forget(gone);
            }
        }
        let two = &mut self.two.participant;
        while two.take(self.two.reader).is_some() {}
        while two.event().is_some() {}
        let names = self.known.names().count();
        assert!(names <= NODES.nodes && self.known.endpoints().count() <= NODES.endpoints);
        assert!(one.participants().count() <= LIMITS.participants);
        assert!(one.endpoints().count() <= LIMITS.endpoints);
        let matched = one.writer(self.one.writer).unwrap().matched();
        assert!(matched <= LIMITS.matches);
    }

    /// All strangers go; the pair is as it was at the beginning.
    pub(crate) fn strangers_go(&mut self, mut goodbye: impl FnMut(GuidPrefix, &mut [u8]) -> usize) {
        let one = &self.one.participant;
        let known = one.participants().map(|known| known.prefix);
        let strangers: Vec<_> = known.filter(|prefix| *prefix != HONEST).collect();
        let mut buf = [0; 200];
        for stranger in strangers {
            let len = goodbye(stranger, &mut buf);
            self.receive(&buf[..len]);
        }
        let one = &self.one.participant;
        assert_eq!(
            (one.participants().count(), one.endpoints().count()),
            (1, 2)
        );
        assert_eq!(one.writer(self.one.writer).unwrap().matched(), 1);
        assert_eq!(self.known.names().count(), 0);
        self.honest();
    }
}
