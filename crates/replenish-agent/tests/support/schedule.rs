//! Whole sessions under a schedule of faults that bytes describe: a publisher, an agent and two
//! readers in virtual time. A sample that was acknowledged and is lost is a failure, and so is one
//! that arrives more often than documented.
//!
//! ```text
//!   bytes ──► steps   write, wait, stall, kill, forge; a step may bring
//!                └──► fates   of the next datagrams: lost, repeated, late
//! ```
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]
#![allow(dead_code, reason = "every test binary uses its own part")]

use super::session::{Client, MS};
use super::sim::{Faults, Sim, member, network};
use replenish_xrce::SeqNum;
use replenish_xrce::client::SessionState;
use replenish_xrce::wire::{
    AckNack, ClientKey, Confirmation, Confirmed, Header, MessageWriter, SessionId, StreamId,
};
use std::ops::Range;

const SECOND: u64 = 1000 * MS;
/// More samples are not written: a script is short.
const MOST: u32 = 4000;
/// The publisher, the reader that is never killed, and the reader that is.
const PUBLISHER: usize = 0;
const READER: usize = 1;
const OTHER: usize = 2;

/// The outcome of a script.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Outcome {
    /// Samples written.
    pub(crate) written: usize,
    /// Samples acknowledged for certain.
    pub(crate) acknowledged: usize,
    /// Of these, samples that `docs/acknowledged.md` does not cover.
    pub(crate) not_covered: usize,
    /// Arrivals of a sample that had arrived before.
    pub(crate) repeated: u64,
    /// Agents killed.
    pub(crate) kills: u32,
}

struct Script<'a>(&'a [u8]);

impl Script<'_> {
    fn byte(&mut self) -> u8 {
        let (first, rest) = self.0.split_first().unwrap_or((&0, &[]));
        self.0 = rest;
        *first
    }
}

struct Whole {
    sim: Sim,
    outcome: Outcome,
    /// The first sample of the publisher that lives.
    first: usize,
    acknowledged: Vec<bool>,
    not_covered: Vec<bool>,
    arrived: Vec<u32>,
    /// The newest sample that has arrived.
    newest: Option<u32>,
    /// Samples that were not acknowledged when their publisher lost its agent.
    may_repeat: Vec<bool>,
    /// Agents that the publisher took for lost.
    publisher_losses: u64,
    /// Messages that this agent confirmed although a reader lacked them, as far as that is settled.
    late: u64,
    /// The reader may have been taken for stuck without being counted there.
    behind: bool,
    /// Sessions that the reader had.
    sessions: u64,
}

/// Carries out a script, then lets every client catch up and looks at what has arrived.
pub(crate) fn run(script: &[u8]) -> Outcome {
    let mut whole = Whole {
        sim: network(1),
        outcome: Outcome::default(),
        first: 0,
        acknowledged: Vec::new(),
        not_covered: Vec::new(),
        arrived: Vec::new(),
        newest: None,
        may_repeat: Vec::new(),
        publisher_losses: 0,
        late: 0,
        behind: false,
        sessions: 1,
    };
    let mut script = Script(script);
    while !script.0.is_empty() {
        whole.step(&mut script);
    }
    whole.end()
}

impl Whole {
    fn step(&mut self, script: &mut Script<'_>) {
        let (what, how) = (script.byte(), script.byte());
        let how = u64::from(how);
        self.show(what % 16, how);
        match what % 16 {
            0..=3 => self.write(1 + how % 32),
            4 | 5 => self.sim.run(how * MS / 4),
            6 => self.sim.run(how * how * MS / 16),
            7..=9 => {
                for _ in 0..=how % 64 {
                    let fate = script.byte();
                    self.sim.fates.push_back(fate);
                }
            }
            10 => self.kill_agent(how * 4 * MS),
            11 => self.kill_publisher(),
            12 => self.restart(OTHER, member(3, "z", "steady")),
            13 => {
                self.behind |= how > 16;
                self.stall(READER, how * 24 * MS);
            }
            14 => self.stall(if how % 2 == 0 { OTHER } else { PUBLISHER }, how * 12 * MS),
            _ => self.forge(how),
        }
        self.collect();
    }

    /// Every step, on request: `REPLENISH_SHOW=1`.
    fn show(&self, what: u8, how: u64) {
        if std::env::var_os("REPLENISH_SHOW").is_some() {
            let (now, taken) = (self.sim.now() / MS, self.sim.taken(PUBLISHER));
            let (certain, newest) = (self.certain(), self.newest);
            let late = self.sim.agent.stats().confirmed_late;
            println!(
                "{now} ms: {what} {how}; {taken} taken, {certain:?} acknowledged, {late} late, \
                 {newest:?} arrived"
            );
        }
    }

    fn write(&mut self, samples: u64) {
        for _ in 0..samples {
            let number = u32::try_from(self.outcome.written).unwrap();
            if number < MOST && self.sim.waiting(PUBLISHER) < 200 {
                // Long enough for a message of its own: messages are counted below.
                let sample = [number.to_le_bytes(); 75].concat();
                self.sim.write(PUBLISHER, StreamId::RELIABLE, &sample);
                self.outcome.written += 1;
                self.acknowledged.push(false);
                self.not_covered.push(false);
                self.may_repeat.push(false);
                self.arrived.push(0);
            }
        }
    }

    fn stall(&mut self, client: usize, time: u64) {
        self.sim.pause(client, true);
        self.sim.run(time);
        self.sim.pause(client, false);
    }

    /// A process that ends and starts again. A log-in within 0.1 s of the one before is taken for a
    /// repeated one.
    fn restart(&mut self, client: usize, session: Client) {
        self.stall(client, 120 * MS);
        self.sim.replace(client, session);
    }

    /// The samples of the living publisher that are acknowledged.
    fn certain(&self) -> Range<usize> {
        let open = self.sim.session(PUBLISHER).unacknowledged();
        self.first..self.sim.taken(PUBLISHER).saturating_sub(open)
    }

    fn note_acknowledged(&mut self) {
        for number in self.certain() {
            self.acknowledged[number] = true;
        }
    }

    /// Samples up to `end` that the reader lacks are not covered by the promises.
    fn does_not_cover(&mut self, range: Range<usize>) {
        for number in range {
            self.not_covered[number] |= self.arrived[number] == 0;
        }
    }

    fn kill_agent(&mut self, down: u64) {
        // An agent takes along what waits for a reader that stood still.
        if self.behind || self.sim.agent.stats().confirmed_late > self.late {
            self.catch_up();
        }
        self.note_acknowledged();
        self.outcome.kills += 1;
        // A reader that is just opening a new session with this agent never will.
        if self.sim.state(READER) != SessionState::Up {
            self.does_not_cover(0..self.sim.taken(PUBLISHER));
        }
        let certain = self.certain().end.max(self.first);
        let had = [PUBLISHER, READER, OTHER].map(|client| self.sessions_of(client));
        self.sim.agent_is_there = false;
        self.sim.run(down);
        self.sim.restart_agent();
        self.sim.agent_is_there = true;
        self.late = 0;
        let back = self.sim.now();
        // All have noticed the new agent.
        self.sim.until(60 * SECOND, "all are back", |sim| {
            let up = |client| sim.state(client) == SessionState::Up;
            let sessions = |client| sim.session(client).link_stats().sessions;
            (0..3).all(|client| up(client) && sessions(client) > had[client])
        });
        self.sessions = self.sessions.max(had[READER] + 1);
        self.lost_agent(certain);
        self.collect();
        // Readers that return after the recovery window, or to a publisher that never knew the
        // agent before.
        if self.sim.now() - back > 2400 * MS || had[PUBLISHER] == 0 {
            self.does_not_cover(certain..self.sim.taken(PUBLISHER));
        }
    }

    fn sessions_of(&self, client: usize) -> u64 {
        self.sim.session(client).link_stats().sessions
    }

    fn kill_publisher(&mut self) {
        self.note_acknowledged();
        self.behind |= !self.sim.fates.is_empty();
        self.restart(PUBLISHER, member(1, "steady", "x"));
        self.publisher_losses = 0;
        self.first = self.sim.taken(PUBLISHER);
    }

    /// A stranger acknowledges in the reader's name, and confirms in the agent's.
    fn forge(&mut self, number: u64) {
        let key = ClientKey([2; 4]);
        let ack = AckNack {
            first_unacked: SeqNum(u16::try_from(number).unwrap_or(0)),
            missing: 0,
            stream: StreamId::RELIABLE,
        };
        let confirmed = Some(Confirmed {
            companions: 0,
            first_unconfirmed: ack.first_unacked,
        });
        let ours = self.sim.session(READER).id();
        for session in [ours, SessionId(ours.0 & 0x7f)] {
            let header = Header::new(session, StreamId::NONE, SeqNum(0), key);
            let mut buf = [0; 64];
            let mut message = MessageWriter::new(&mut buf, &header).unwrap();
            message.push(&Confirmation { ack, confirmed }).unwrap();
            self.sim.stranger_sends(message.finish());
        }
    }

    /// The publisher has lost its agent: what is not acknowledged is sent again.
    fn lost_agent(&mut self, acknowledged: usize) {
        let open = acknowledged..self.sim.taken(PUBLISHER);
        self.may_repeat[open].fill(true);
        self.publisher_losses = self.sim.session(PUBLISHER).link_stats().losses;
    }

    /// Takes what has arrived: undamaged, and in order but for repeated samples.
    fn collect(&mut self) {
        // A publisher that took a living agent for lost.
        if self.sim.session(PUBLISHER).link_stats().losses != self.publisher_losses {
            self.lost_agent(self.first);
        }
        // A reader that was taken for dead, and opened a new session with the same agent.
        let sessions = self.sessions_of(READER);
        if sessions != self.sessions && self.sim.state(READER) == SessionState::Up {
            self.sessions = sessions;
            self.does_not_cover(0..self.sim.taken(PUBLISHER));
            self.newest = None;
        }
        for got in self.sim.take(READER) {
            let (number, rest) = got.split_first_chunk::<4>().unwrap();
            assert!(rest.chunks(4).all(|chunk| chunk == number), "damaged");
            let number = u32::from_le_bytes(*number);
            let times = &mut self.arrived[number as usize];
            *times += 1;
            if *times == 1 {
                assert!(
                    self.newest < Some(number),
                    "{number} after {:?}",
                    self.newest
                );
                self.newest = Some(number);
            } else {
                self.outcome.repeated += 1;
                let agent_was_lost = self.may_repeat[number as usize];
                assert!(agent_was_lost, "{number} came again, and was acknowledged");
            }
        }
        self.sim.take(OTHER);
    }

    fn until_up(&mut self) {
        let up = |sim: &Sim| (0..3).all(|client| sim.state(client) == SessionState::Up);
        self.sim.until(60 * SECOND, "all are up", up);
    }

    /// Nothing is under way any more.
    fn catch_up(&mut self) {
        self.until_up();
        self.sim.until(120 * SECOND, "all have caught up", |sim| {
            sim.waiting(PUBLISHER) == 0 && sim.session(PUBLISHER).is_delivered()
        });
        self.sim.run(2 * SECOND);
        self.collect();
        self.late = self.sim.agent.stats().confirmed_late;
        self.behind = false;
    }

    fn end(mut self) -> Outcome {
        self.sim.fates.clear();
        self.sim.faults = Faults::NONE;
        self.catch_up();
        self.note_acknowledged();
        let all = self.acknowledged.iter().zip(&self.not_covered);
        for (number, (acknowledged, not_covered)) in all.enumerate() {
            let arrived = self.arrived[number];
            self.outcome.acknowledged += usize::from(*acknowledged);
            self.outcome.not_covered += usize::from(*acknowledged && *not_covered);
            assert!(
                arrived > 0 || !acknowledged || *not_covered,
                "{number} was acknowledged and is lost"
            );
            assert!(
                arrived <= 2 + self.outcome.kills,
                "{number} came {arrived} times"
            );
        }
        assert_eq!(self.sim.agent.stats().clients, 3);
        self.outcome
    }
}
