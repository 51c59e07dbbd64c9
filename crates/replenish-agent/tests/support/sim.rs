//! A network in virtual time: clients, an agent, and datagrams under way between them.
//!
//! Nothing sleeps and nothing is random but by the seed: the clock jumps from event to event.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]
#![allow(dead_code, reason = "every test binary uses its own part")]

use super::session::{Client, MS, WRITER, endpoints, session};
use replenish_agent::{AgentCore, Limits, Now};
use replenish_xrce::client::{Event, SessionState, WriteError};
use replenish_xrce::wire::StreamId;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

/// Enough that a rough link is not taken for a lost agent.
const PATIENCE: u64 = 6000 * MS;

/// What a link does to datagrams, in thousandths and nanoseconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Faults {
    pub(crate) loss: u64,
    pub(crate) repeat: u64,
    pub(crate) delay: (u64, u64),
}

impl Faults {
    pub(crate) const NONE: Faults = Faults {
        loss: 0,
        repeat: 0,
        delay: (MS / 10, MS / 10),
    };

    pub(crate) fn seeded(self, seed: u64) -> (Faults, u64) {
        (self, seed)
    }
}

impl From<Faults> for (Faults, u64) {
    fn from(faults: Faults) -> Self {
        (faults, 1)
    }
}

struct Node {
    session: Client,
    /// What was written while the stream was full, or the session down.
    outbox: VecDeque<(StreamId, Vec<u8>)>,
    /// How many samples the session has taken.
    taken: usize,
    got: Vec<Vec<u8>>,
}

/// A datagram under way; ordered by arrival.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct UnderWay {
    at: u64,
    order: u64,
    client: usize,
    to_agent: bool,
    bytes: Vec<u8>,
}

pub(crate) struct Sim {
    pub(crate) agent: AgentCore<usize>,
    /// If not, what is sent to it vanishes.
    pub(crate) agent_is_there: bool,
    now: u64,
    nodes: Vec<Node>,
    wire: BinaryHeap<Reverse<UnderWay>>,
    order: u64,
    faults: Faults,
    random: u64,
}

impl Sim {
    pub(crate) fn new(faults: impl Into<(Faults, u64)>) -> Self {
        let (faults, seed) = faults.into();
        Self {
            agent: AgentCore::new(Limits::default()),
            agent_is_there: true,
            now: 0,
            nodes: Vec::new(),
            wire: BinaryHeap::new(),
            order: 0,
            faults,
            random: seed | 1,
        }
    }

    /// Adds a client, which begins to log in; gives its number.
    pub(crate) fn client(&mut self) -> usize {
        let key = u8::try_from(self.nodes.len() + 1).unwrap();
        self.client_with(session(key, PATIENCE))
    }

    /// The same with a session of its own.
    pub(crate) fn client_with(&mut self, mut session: Client) -> usize {
        let number = self.nodes.len();
        session.connect(self.now);
        self.nodes.push(Node {
            session,
            outbox: VecDeque::new(),
            taken: 0,
            got: Vec::new(),
        });
        number
    }

    /// The client's process ends and starts again.
    pub(crate) fn restart_client(&mut self, client: usize) {
        self.nodes[client].session = session(u8::try_from(client + 1).unwrap(), PATIENCE);
        self.nodes[client].session.connect(self.now);
    }

    /// The agent's process ends and starts again.
    pub(crate) fn restart_agent(&mut self) {
        self.agent = AgentCore::new(Limits::default());
    }

    pub(crate) fn close(&mut self, client: usize) {
        self.nodes[client].session.close(self.now);
        self.flush();
    }

    pub(crate) fn state(&self, client: usize) -> SessionState {
        self.nodes[client].session.state()
    }

    pub(crate) fn all_up(&self) -> bool {
        self.nodes
            .iter()
            .all(|node| node.session.state() == SessionState::Up)
    }

    /// A participant with a writer of one topic and a reader of another.
    pub(crate) fn endpoint(&mut self, client: usize, writes: &str, reads: &str, stream: StreamId) {
        endpoints(&mut self.nodes[client].session, writes, reads, stream);
        self.flush();
    }

    /// Writes a sample, later if there is no room now.
    pub(crate) fn write(&mut self, client: usize, stream: StreamId, payload: &[u8]) {
        self.nodes[client]
            .outbox
            .push_back((stream, payload.to_vec()));
        self.flush();
    }

    /// What the clock says.
    pub(crate) fn now(&self) -> u64 {
        self.now
    }

    /// A client's session.
    pub(crate) fn session(&self, client: usize) -> &Client {
        &self.nodes[client].session
    }

    /// How many samples a client's session has taken.
    pub(crate) fn taken(&self, client: usize) -> usize {
        self.nodes[client].taken
    }

    /// How many samples have arrived and were not taken.
    pub(crate) fn received(&self, client: usize) -> usize {
        self.nodes[client].got.len()
    }

    pub(crate) fn take(&mut self, client: usize) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.nodes[client].got)
    }

    /// Lets `nanos` pass.
    pub(crate) fn run(&mut self, nanos: u64) {
        let end = self.now + nanos;
        while self.step(end) {}
        self.now = end;
    }

    /// Lets time pass until `done`, at most `nanos`.
    pub(crate) fn until(&mut self, nanos: u64, what: &str, done: impl Fn(&Self) -> bool) {
        let end = self.now + nanos;
        while !done(self) {
            let states: Vec<SessionState> = self.nodes.iter().map(|n| n.session.state()).collect();
            let stats = self.agent.stats();
            assert!(self.step(end), "in vain: {what} ({states:?}, {stats:?})");
        }
    }

    /// Goes to the next event; false if there is none up to `end`.
    fn step(&mut self, end: u64) -> bool {
        let arrival = self.wire.peek().map(|Reverse(datagram)| datagram.at);
        let sessions = self
            .nodes
            .iter()
            .filter_map(|node| node.session.next_deadline());
        let agent = self.agent.next_deadline().filter(|_| self.agent_is_there);
        let next = sessions.chain(arrival).chain(agent).min();
        let Some(next) = next.filter(|next| *next <= end) else {
            return false;
        };
        self.now = self.now.max(next);
        while self
            .wire
            .peek()
            .is_some_and(|Reverse(datagram)| datagram.at <= self.now)
        {
            let Some(Reverse(datagram)) = self.wire.pop() else {
                break;
            };
            self.arrive(&datagram);
        }
        for node in &mut self.nodes {
            let Node { session, got, .. } = node;
            session.tick(self.now, &mut |event| keep(got, &event));
        }
        self.flush();
        true
    }

    fn arrive(&mut self, datagram: &UnderWay) {
        if !datagram.to_agent {
            let Node { session, got, .. } = &mut self.nodes[datagram.client];
            session.handle(self.now, &datagram.bytes, &mut |event| keep(got, &event));
        } else if self.agent_is_there {
            let now = Now {
                monotonic: self.now,
                unix: 0,
            };
            self.agent.receive(now, datagram.client, &datagram.bytes);
        }
    }

    /// Puts everything on the wire that wants to be sent.
    fn flush(&mut self) {
        let now = Now {
            monotonic: self.now,
            unix: 0,
        };
        let mut sent = Vec::new();
        if self.agent_is_there {
            let mut send = |to: &usize, bytes: &[u8]| sent.push((*to, false, bytes.to_vec()));
            while self.agent.pump(now, 5, &mut send) {}
        }
        for (number, node) in self.nodes.iter_mut().enumerate() {
            loop {
                while let Some(bytes) = node.session.poll_transmit(self.now) {
                    sent.push((number, true, bytes.to_vec()));
                }
                let Some((stream, payload)) = node.outbox.front() else {
                    break;
                };
                match node.session.write(WRITER, *stream, payload) {
                    Ok(()) => {
                        node.taken += 1;
                        node.outbox.pop_front();
                    }
                    Err(WriteError::WouldBlock | WriteError::Down) => break,
                    Err(error) => panic!("{error}"),
                }
            }
        }
        for (client, to_agent, bytes) in sent {
            self.put_on_the_wire(client, to_agent, &bytes);
        }
    }

    fn put_on_the_wire(&mut self, client: usize, to_agent: bool, bytes: &[u8]) {
        let copies = if self.chance(self.faults.loss) {
            0
        } else {
            1 + u64::from(self.chance(self.faults.repeat))
        };
        for _ in 0..copies {
            let (least, most) = self.faults.delay;
            let at = self.now + least + self.random() % (most - least + 1);
            self.order += 1;
            let order = self.order;
            let bytes = bytes.to_vec();
            self.wire.push(Reverse(UnderWay {
                at,
                order,
                client,
                to_agent,
                bytes,
            }));
        }
    }

    fn chance(&mut self, thousandths: u64) -> bool {
        self.random() % 1000 < thousandths
    }

    /// xorshift64*.
    fn random(&mut self) -> u64 {
        self.random ^= self.random >> 12;
        self.random ^= self.random << 25;
        self.random ^= self.random >> 27;
        self.random.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16
    }
}

fn keep(got: &mut Vec<Vec<u8>>, event: &Event<'_>) {
    if let Event::Data { payload, .. } = event {
        got.push(payload.to_vec());
    }
}
