//! An agent that gets any datagrams from several addresses, at any time.

use super::{MS, Script};
use replenish_agent::{AgentConfig, AgentCore, Limits, Now, Stats, TopicRule};
use replenish_xrce::SeqNum;
use replenish_xrce::wire::{
    Body, ClientKey, CreateClient, Header, Message, MessageWriter, Properties, SessionId, StreamId,
    VENDOR, VERSION,
};
use std::collections::BTreeMap;

pub(crate) const LIMITS: Limits = Limits {
    clients: 4,
    entities: 12,
    streams: 3,
    message: 1000,
    sample: 5000,
    client_bytes: 200_000,
    default_depth: 4,
    max_depth: 8,
    calls: 3,
    datagrams_per_second: 0,
    unauthenticated_per_second: 0,
    writer_block_limit: Some(300 * MS),
    silence: 10_000 * MS,
    ..Limits::DEFAULT
};

/// Addresses there are.
const PEERS: u8 = 4;

/// An agent under fire.
pub(crate) struct Agent {
    pub(super) core: AgentCore<u8>,
    now: u64,
    steps: u64,
    /// The next number on each stream of each address, as far as the agent's answers show.
    next: BTreeMap<(u8, u8), u16>,
}

impl Agent {
    /// An agent without clients.
    pub(crate) fn new() -> Self {
        let core = AgentCore::with(&AgentConfig {
            limits: LIMITS,
            rules: vec![TopicRule::new("urgent", 7), TopicRule::new("slow", 1)],
            ..AgentConfig::default()
        });
        Self::of(core)
    }

    /// The same with settings of its own.
    pub(super) fn of(core: AgentCore<u8>) -> Self {
        Self {
            core,
            now: 0,
            steps: 0,
            next: BTreeMap::new(),
        }
    }

    /// Carries out a script from its beginning.
    pub(crate) fn run(script: &[u8]) {
        let mut agent = Self::new();
        let mut script = Script(script);
        while !script.is_empty() {
            agent.step(&mut script);
        }
        agent.end();
    }

    /// One step: an operation, and what belongs to it. Two bits say which address, the next three
    /// what happens there; a datagram follows with its length before it.
    pub(crate) fn step(&mut self, script: &mut Script<'_>) {
        let op = script.byte();
        let peer = op % PEERS;
        match op / PEERS % 8 {
            0 => {
                let bytes = script.run();
                self.core.receive(self.at(), peer, bytes);
            }
            1..=3 => {
                let bytes = self.in_order(peer, script.run());
                self.core.receive(self.at(), peer, &bytes);
            }
            4 => self.now += MS * u64::from(script.byte()),
            5 => {
                let time = u64::from(script.byte());
                self.now += MS * time * time / 16;
            }
            6 => self.core.hold(|at| *at == peer),
            _ if script.byte() == 0 => self.core.gone(|at| *at == peer),
            _ => self.core.release(self.at(), |at| *at == peer),
        }
        self.pump();
        self.steps += 1;
        if self.steps.is_multiple_of(64) {
            self.check();
        }
    }

    pub(super) fn at(&self) -> Now {
        Now {
            monotonic: self.now,
            unix: 0,
        }
    }

    /// The same with the number that is due on its stream, so that it is not dropped for that.
    fn in_order(&mut self, peer: u8, bytes: &[u8]) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        if let [_, stream, low, high, ..] = &mut bytes[..]
            && *stream > 0
        {
            let next = self.next.entry((peer, *stream)).or_default();
            [*low, *high] = next.to_le_bytes();
            *next = next.wrapping_add(u16::from(*stream < 0x80));
        }
        bytes
    }

    /// Sends until there is nothing more to send, which must come soon.
    pub(super) fn pump(&mut self) {
        let (now, mut sent) = (self.at(), 0);
        let next = &mut self.next;
        while self.core.pump(now, 16, &mut |peer, bytes| {
            assert!((4..=LIMITS.message).contains(&bytes.len()), "{bytes:02x?}");
            sent += 1;
            let message = Message::parse(bytes).expect("the agent sends messages");
            for submessage in message.submessages() {
                match submessage.expect("a submessage").body().expect("a body") {
                    Body::AckNack(ack) => {
                        next.insert((*peer, ack.stream.0), ack.first_unacked.0);
                    }
                    Body::StatusAgent(_) => next.retain(|(at, _), _| at != peer),
                    _ => {}
                }
            }
        }) {
            assert!(sent < 20_000, "no end");
        }
        // Nothing is left undone, or this would be asked for again without end.
        let next = self.core.next_deadline();
        assert!(next.is_none_or(|at| at > self.now), "{next:?}");
    }

    /// The agent's counters.
    pub(crate) fn stats(&self) -> Stats {
        self.core.stats()
    }

    /// Everything is within its limits.
    pub(crate) fn check(&mut self) {
        let snapshot = self.core.snapshot(self.at());
        assert!(snapshot.clients.len() <= LIMITS.clients);
        assert!(snapshot.queued_bytes <= LIMITS.memory());
        for client in &snapshot.clients {
            assert!(client.bytes <= LIMITS.client_bytes, "{}", client.bytes);
            assert!(client.entities.len() <= LIMITS.entities);
            assert!(client.streams.len() <= 2 * LIMITS.streams);
        }
    }

    /// After a silence nothing is left of any client.
    pub(crate) fn end(&mut self) {
        self.check();
        self.core.release(self.at(), |_| true);
        self.now += LIMITS.silence;
        self.pump();
        let snapshot = self.core.snapshot(self.at());
        assert_eq!(snapshot.clients.len(), 0);
        assert_eq!((snapshot.topics, snapshot.queued_bytes), (0, 0));
        assert_eq!(self.core.next_deadline(), None);
    }

    pub(crate) fn header(session: u8, stream: u8, seq: u16) -> Header {
        let key = ClientKey([1; 4]);
        Header::new(SessionId(session), StreamId(stream), SeqNum(seq), key)
    }
}

/// The log-in of client `number`.
pub(crate) fn login(number: u8, session: u8) -> Vec<u8> {
    let session = SessionId(session);
    let key = ClientKey([number + 1; 4]);
    let create = CreateClient {
        version: VERSION,
        vendor: VENDOR,
        key,
        session,
        properties: Properties::None,
        mtu: 512,
    };
    let mut buf = [0; 64];
    let header = Header::new(session.before_login(), StreamId::NONE, SeqNum(0), key);
    let mut message = MessageWriter::new(&mut buf, &header).unwrap();
    message.push(&create).unwrap();
    message.finish().to_vec()
}
