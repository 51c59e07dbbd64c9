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

use super::session::{Client, MS, WRITER, endpoints, keep_all, session, session_with};
use replenish_agent::{AgentCore, Limits, Now};
use replenish_xrce::client::{Config, Event, SessionState, WriteError};
use replenish_xrce::wire::{ClientKey, StreamId};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap, VecDeque};

/// Enough that a rough link is not taken for a lost agent.
const PATIENCE: u64 = 6000 * MS;

/// An address that is no client's.
const STRANGER: usize = usize::MAX;

/// A link's damage to datagrams, in thousandths and nanoseconds.
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
    /// Samples written while the stream was full, or the session down.
    outbox: VecDeque<(StreamId, Vec<u8>)>,
    /// Number of samples that the session has taken.
    taken: usize,
    /// It stands still: what comes for it is lost.
    paused: bool,
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
    pub(crate) faults: Faults,
    random: u64,
    /// The fates of the next datagrams, a byte each; `faults` decides after them.
    pub(crate) fates: VecDeque<u8>,
    /// Datagrams of each client and direction that `fates` has lost in a row.
    lost: BTreeMap<(usize, bool), u8>,
}

/// `fates` loses no more in a row: a peer whose every datagram is lost is taken for dead.
const MOST_LOST: u8 = 3;

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
            fates: VecDeque::new(),
            lost: BTreeMap::new(),
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
            paused: false,
            got: Vec::new(),
        });
        number
    }

    /// The client's process ends and starts again.
    pub(crate) fn restart_client(&mut self, client: usize) {
        self.nodes[client].session = session(u8::try_from(client + 1).unwrap(), PATIENCE);
        self.nodes[client].session.connect(self.now);
    }

    /// The same with a session of its own. A new process has a new port: datagrams from and to the
    /// old one reach no process.
    pub(crate) fn replace(&mut self, client: usize, session: Client) {
        self.wire
            .retain(|Reverse(datagram)| datagram.client != client);
        self.nodes[client].session = session;
        self.nodes[client].session.connect(self.now);
    }

    /// Lets a client stand still, or go on.
    pub(crate) fn pause(&mut self, client: usize, paused: bool) {
        self.nodes[client].paused = paused;
    }

    /// Samples that a client's session has not taken.
    pub(crate) fn waiting(&self, client: usize) -> usize {
        self.nodes[client].outbox.len()
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

    /// The clock's time.
    pub(crate) fn now(&self) -> u64 {
        self.now
    }

    /// A client's session.
    pub(crate) fn session(&self, client: usize) -> &Client {
        &self.nodes[client].session
    }

    /// Number of samples that a client's session has taken.
    pub(crate) fn taken(&self, client: usize) -> usize {
        self.nodes[client].taken
    }

    /// Number of samples that have arrived and were not taken.
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
            .filter(|node| !node.paused)
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
        for node in self.nodes.iter_mut().filter(|node| !node.paused) {
            let Node { session, got, .. } = node;
            session.tick(self.now, &mut |event| keep(got, &event));
        }
        self.flush();
        true
    }

    fn arrive(&mut self, datagram: &UnderWay) {
        if !datagram.to_agent {
            let node = &mut self.nodes[datagram.client];
            if node.paused {
                return;
            }
            let Node { session, got, .. } = node;
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
        let running = |(_, node): &(usize, &mut Node)| !node.paused;
        for (number, node) in self.nodes.iter_mut().enumerate().filter(running) {
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

    /// A datagram that the agent gets at once, from an address that is no client's.
    pub(crate) fn stranger_sends(&mut self, bytes: &[u8]) {
        if self.agent_is_there {
            let now = Now {
                monotonic: self.now,
                unix: 0,
            };
            self.agent.receive(now, STRANGER, bytes);
        }
        self.flush();
    }

    fn put_on_the_wire(&mut self, client: usize, to_agent: bool, bytes: &[u8]) {
        if client == STRANGER {
            return;
        }
        if let Some(fate) = self.fates.pop_front() {
            self.meet(fate, client, to_agent, bytes);
            return;
        }
        let copies = if self.chance(self.faults.loss) {
            0
        } else {
            1 + u64::from(self.chance(self.faults.repeat))
        };
        for _ in 0..copies {
            let (least, most) = self.faults.delay;
            let at = self.now + least + self.random() % (most - least + 1);
            self.send_at(at, client, to_agent, bytes);
        }
    }

    /// Three bits of `fate` say what happens to a datagram, the others when it arrives.
    fn meet(&mut self, fate: u8, client: usize, to_agent: bool, bytes: &[u8]) {
        let (what, when) = (fate % 8, u64::from(fate / 8));
        let lost = self.lost.entry((client, to_agent)).or_default();
        // A damaged datagram is lost: UDP's checksum finds the damage.
        if what < 2 && *lost < MOST_LOST {
            *lost += 1;
            return;
        }
        *lost = 0;
        let soon = self.now + MS / 10 + when * MS / 5;
        self.send_at(soon, client, to_agent, bytes);
        match what {
            2 => self.send_at(soon + when * MS, client, to_agent, bytes),
            3 => self.send_at(self.now + when * 4 * MS, client, to_agent, bytes),
            _ => {}
        }
    }

    fn send_at(&mut self, at: u64, client: usize, to_agent: bool, bytes: &[u8]) {
        self.order += 1;
        self.wire.push(Reverse(UnderWay {
            at,
            order: self.order,
            client,
            to_agent,
            bytes: bytes.to_vec(),
        }));
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

/// A writer, client 0, and two readers that want all.
pub(crate) fn network(seed: u64) -> Sim {
    let mut sim = Sim::new(Faults::NONE.seeded(seed));
    for (key, writes, reads) in [(1, "steady", "x"), (2, "y", "steady"), (3, "z", "steady")] {
        sim.client_with(member(key, writes, reads));
    }
    sim.until(60_000 * MS, "all are up", Sim::all_up);
    sim
}

/// A client whose writer and reader are reliable and keep all.
pub(crate) fn member(key: u8, writes: &str, reads: &str) -> Client {
    let config = Config {
        confirm_delivery: true,
        ..Config::new(ClientKey([key; 4]))
    };
    let mut session = session_with(config, 800 * MS);
    keep_all(&mut session, writes, reads, StreamId::RELIABLE);
    session
}
