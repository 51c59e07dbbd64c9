//! A session over a bad link, in virtual time and with every set of features: what is reliable
//! arrives once and in order in both directions, and the agent's restart is survived.

use crate::fake_agent::FakeAgent;
use replenish_xrce::Nanos;
use replenish_xrce::client::{
    Buffers, Config, Event, ReliableBuffers, Session, SessionState, WriteError,
};
use replenish_xrce::features::DELIVERY;
use replenish_xrce::wire::{
    ClientKey, CreationMode, DeliveryControl, Entity, ObjectId, ObjectKind, ParticipantBinary,
    Representation, StreamId,
};

const MILLI: Nanos = 1_000_000;
const MTU: usize = 128;
const WINDOW: usize = 4;
const PARTICIPANT: ObjectId = ObjectId::new(1, ObjectKind::Participant);
const WRITER: ObjectId = ObjectId::new(1, ObjectKind::DataWriter);
const READER: ObjectId = ObjectId::new(1, ObjectKind::DataReader);

/// A microcontroller's session: four messages each way, no room to keep samples for the next agent.
type Client = Session<Vec<u8>, WINDOW, 8>;

/// Loses one of `one_in` datagrams and delivers one of as many twice; the same in every run.
struct Line {
    random: u64,
    one_in: u64,
}

impl Line {
    fn copies(&mut self) -> usize {
        self.random = self
            .random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        match (self.random >> 33) % self.one_in {
            0 => 0,
            1 => 2,
            _ => 1,
        }
    }
}

struct World {
    session: Client,
    agent: FakeAgent,
    line: Line,
    on: bool,
    now: Nanos,
    up: usize,
    got: Vec<u32>,
}

impl World {
    fn new(seed: u64, one_in: u64) -> Self {
        let reliable = ReliableBuffers {
            output: vec![0; WINDOW * MTU],
            large_output: Vec::new(),
            input: vec![0; WINDOW * MTU],
            fragments: Vec::new(),
        };
        let buffers = Buffers {
            best_effort: [vec![0; MTU]],
            reliable: [reliable],
            journal: vec![0; 128],
            restore: Vec::new(),
        };
        let config = Config {
            mtu: MTU as u16,
            ..Config::new(ClientKey(*b"loss"))
        };
        let mut world = World {
            session: Session::new(config, buffers),
            agent: FakeAgent::new(),
            line: Line {
                random: seed,
                one_in,
            },
            on: true,
            now: 0,
            up: 0,
            got: Vec::new(),
        };
        world.session.connect(0);
        let name = Some("lossy");
        let entity = Entity::Participant {
            repr: Representation::Binary(ParticipantBinary {
                domain_reference: None,
                name,
            }),
            domain: 0,
        };
        let mode = CreationMode::REUSE_OR_REPLACE;
        world.session.create(PARTICIPANT, mode, &entity).unwrap();
        world
            .session
            .read(READER, StreamId::RELIABLE, DeliveryControl::UNLIMITED)
            .unwrap();
        world
    }

    fn arrive(&mut self, datagrams: Vec<Vec<u8>>) {
        for datagram in datagrams {
            for _ in 0..self.line.copies() {
                let (up, got) = (&mut self.up, &mut self.got);
                self.session
                    .handle(self.now, &datagram, &mut |event| match event {
                        Event::Up => *up += 1,
                        Event::Data { payload, .. } => {
                            got.push(u32::from_le_bytes(payload.try_into().unwrap()));
                        }
                        _ => {}
                    });
            }
        }
    }

    /// A millisecond.
    fn step(&mut self) {
        self.now += MILLI;
        let up = &mut self.up;
        self.session.tick(self.now, &mut |event| {
            *up += usize::from(event == Event::Up);
        });
        while let Some(datagram) = self.session.poll_transmit(self.now).map(<[u8]>::to_vec) {
            for _ in 0..self.line.copies() {
                if self.on {
                    let answers = self.agent.handle(self.now, &datagram);
                    self.arrive(answers);
                }
            }
        }
        if self.on {
            let datagrams = self.agent.tick(self.now);
            self.arrive(datagrams);
        }
    }

    fn until(&mut self, what: &str, done: impl Fn(&Self) -> bool) {
        let end = self.now + 60_000 * MILLI;
        while !done(self) {
            self.step();
            assert!(self.now < end, "{what}: not within a minute");
        }
    }

    /// Writes the numbers of `range`, and has the agent send them, too.
    fn exchange(&mut self, range: std::ops::Range<u32>) {
        for number in range {
            loop {
                let sample = number.to_le_bytes();
                match self.session.write(WRITER, StreamId::RELIABLE, &sample) {
                    Ok(()) => break,
                    Err(WriteError::WouldBlock) => self.step(),
                    Err(error) => panic!("{error}"),
                }
            }
            // The agent's stream keeps sixteen messages.
            self.until("room at the agent", |world| world.agent.is_idle());
            let datagrams = self.agent.deliver(self.now, READER, &number.to_le_bytes());
            self.arrive(datagrams);
        }
        self.until("everything has arrived", |world| {
            world.session.is_delivered() && world.agent.is_idle()
        });
    }

    fn written(&self) -> Vec<u32> {
        let number =
            |(_, sample): &(_, Vec<u8>)| u32::from_le_bytes(sample.as_slice().try_into().unwrap());
        self.agent.written.iter().map(number).collect()
    }
}

#[test]
fn what_is_reliable_arrives_once_and_in_order_over_a_bad_line() {
    for seed in 0..8 {
        let mut world = World::new(seed, 5);
        world.until("the session is up", |world| world.up == 1);
        world.exchange(0..200);
        let all: Vec<u32> = (0..200).collect();
        assert_eq!(
            (world.written(), &world.got),
            (all.clone(), &all),
            "seed {seed}"
        );
        let output = world.session.output_stats();
        assert!(output.resent > 0 && output.bogus_acks == 0, "{output:?}");
    }
}

#[test]
fn the_agents_restart_is_survived_and_what_is_lost_by_it_counted() {
    let mut world = World::new(7, 20);
    world.until("the session is up", |world| world.up == 1);
    world.exchange(0..50);
    world.on = false;
    for number in [50_u32, 51] {
        let sample = number.to_le_bytes();
        world
            .session
            .write(WRITER, StreamId::RELIABLE, &sample)
            .unwrap();
        world.step();
    }
    world.until("the loss is noticed", |world| {
        world.session.state() == SessionState::Connecting
    });
    world.agent.restart();
    world.on = true;
    world.until("the session is up again", |world| world.up == 2);
    assert_eq!(world.agent.created, [PARTICIPANT]);
    assert_eq!(world.agent.reads.len(), 1);
    let stats = world.session.link_stats();
    assert_eq!((stats.losses, stats.unacknowledged, stats.lost), (1, 2, 2));
    assert_eq!(stats.carried, 0, "no room, or {DELIVERY}");
    world.exchange(100..150);
    let all: Vec<u32> = (0..50).chain(100..150).collect();
    assert_eq!((world.written(), &world.got), (all.clone(), &all));
}
