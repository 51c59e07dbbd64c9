//! A session and its agent's presence, in virtual time: log-in, loss, return, refusals, and
//! whatever else a peer may send.

use crate::fake_agent::FakeAgent;
use proptest::prelude::*;
use replenish_xrce::Nanos;
use replenish_xrce::client::{
    Buffers, Config, Event, ReliableBuffers, RequestError, RequestState, Session, SessionState,
    WriteError,
};
use replenish_xrce::features::{FRAGMENTS, QUERIES};
use replenish_xrce::stream::PushError;
use replenish_xrce::wire::{
    ClientKey, CreationMode, DataReaderBinary, DataWriterBinary, DeliveryControl, Entity,
    GroupBinary, ObjectId, ObjectKind, ParticipantBinary, Representation, SessionId, Status,
    StreamId, TopicBinary, WireTime,
};

const MILLI: Nanos = 1_000_000;
const SECOND: Nanos = 1_000_000_000;
/// Bytes of a sample that is large: in several messages where that is possible.
const LARGE: usize = if FRAGMENTS { 4000 } else { 400 };

const PARTICIPANT: ObjectId = ObjectId::new(1, ObjectKind::Participant);
const TOPIC: ObjectId = ObjectId::new(1, ObjectKind::Topic);
const PUBLISHER: ObjectId = ObjectId::new(1, ObjectKind::Publisher);
const WRITER: ObjectId = ObjectId::new(1, ObjectKind::DataWriter);
const SUBSCRIBER: ObjectId = ObjectId::new(1, ObjectKind::Subscriber);
const READER: ObjectId = ObjectId::new(1, ObjectKind::DataReader);

#[derive(Clone, Debug, PartialEq)]
enum Told {
    Up,
    Down,
    Refused(Status),
    Status(ObjectId, Status),
    Data(ObjectId, Vec<u8>),
    Time(i64),
    Closed,
    Other,
}

fn told(event: Event<'_>) -> Told {
    match event {
        Event::Up => Told::Up,
        Event::Down => Told::Down,
        Event::Refused(status) => Told::Refused(status),
        Event::Status { object, status, .. } => Told::Status(object, status),
        Event::Data {
            reader, payload, ..
        } => Told::Data(reader, payload.to_vec()),
        Event::Time(reply) => Told::Time(reply.offset(reply.originate)),
        Event::Closed => Told::Closed,
        _ => Told::Other,
    }
}

/// A session, its agent and the time. Datagrams take no time; those to an agent that is off are
/// lost.
struct World {
    session: Session<Vec<u8>, 16, 16>,
    agent: FakeAgent,
    agent_on: bool,
    now: Nanos,
    told: Vec<Told>,
}

impl World {
    fn new() -> Self {
        World::with(Config::new(ClientKey([1, 2, 3, 4])))
    }

    fn with(config: Config) -> Self {
        let buffers = Buffers {
            best_effort: [vec![0; 512]],
            reliable: [ReliableBuffers {
                output: vec![0; 16 * 512],
                large_output: Vec::new(),
                input: vec![0; 16 * 512],
                fragments: vec![0; 6000],
            }],
            journal: vec![0; 1024],
            restore: Vec::new(),
        };
        World {
            session: Session::new(config, buffers),
            agent: FakeAgent::new(),
            agent_on: true,
            now: 10 * SECOND,
            told: Vec::new(),
        }
    }

    fn arrive(&mut self, datagrams: Vec<Vec<u8>>) {
        for datagram in datagrams {
            let now = self.now;
            self.session
                .handle(now, &datagram, &mut |event| self.told.push(told(event)));
        }
    }

    /// Exchanges datagrams until neither side has any.
    fn settle(&mut self) {
        let now = self.now;
        self.session
            .tick(now, &mut |event| self.told.push(told(event)));
        while let Some(datagram) = self.session.poll_transmit(now).map(<[u8]>::to_vec) {
            if self.agent_on {
                let answers = self.agent.handle(now, &datagram);
                self.arrive(answers);
            }
        }
    }

    /// Lets time pass, stopping wherever the session wants to do something.
    fn run(&mut self, duration: Nanos) {
        let end = self.now + duration;
        self.settle();
        while let Some(next) = self.session.next_deadline().filter(|next| *next <= end) {
            assert!(
                next > self.now,
                "the session asks for the same instant again"
            );
            self.now = next;
            if self.agent_on {
                let datagrams = self.agent.tick(next);
                self.arrive(datagrams);
            }
            self.settle();
        }
        self.now = end;
        self.settle();
    }

    fn take_told(&mut self) -> Vec<Told> {
        std::mem::take(&mut self.told)
    }

    fn connect(&mut self) {
        self.session.connect(self.now);
        self.settle();
        assert_eq!(self.take_told(), [Told::Up]);
    }

    fn create_all(&mut self) {
        let mode = CreationMode::REUSE_OR_REPLACE;
        let group = Representation::Binary(GroupBinary::default());
        let topic = TopicBinary {
            name: "rt/chatter",
            type_reference: None,
            type_name: Some("std_msgs::msg::dds_::Int32_"),
        };
        let participant = ParticipantBinary {
            name: Some("talker"),
            ..Default::default()
        };
        let entities = [
            (
                PARTICIPANT,
                Entity::Participant {
                    repr: Representation::Binary(participant),
                    domain: 0,
                },
            ),
            (
                TOPIC,
                Entity::Topic {
                    repr: Representation::Binary(topic),
                    participant: PARTICIPANT,
                },
            ),
            (
                PUBLISHER,
                Entity::Publisher {
                    repr: group,
                    participant: PARTICIPANT,
                },
            ),
            (
                WRITER,
                Entity::DataWriter {
                    repr: Representation::Binary(DataWriterBinary {
                        topic: TOPIC,
                        qos: None,
                    }),
                    publisher: PUBLISHER,
                },
            ),
            (
                SUBSCRIBER,
                Entity::Subscriber {
                    repr: group,
                    participant: PARTICIPANT,
                },
            ),
            (
                READER,
                Entity::DataReader {
                    repr: Representation::Binary(DataReaderBinary {
                        topic: TOPIC,
                        qos: None,
                    }),
                    subscriber: SUBSCRIBER,
                },
            ),
        ];
        for (object, entity) in entities {
            self.session.create(object, mode, &entity).unwrap();
        }
        self.session
            .read(READER, StreamId::BEST_EFFORT, DeliveryControl::UNLIMITED)
            .unwrap();
    }
}

const ALL: [ObjectId; 6] = [PARTICIPANT, TOPIC, PUBLISHER, WRITER, SUBSCRIBER, READER];

#[test]
fn logs_in_creates_writes_and_reads() {
    let mut world = World::new();
    assert_eq!(
        world.session.write(WRITER, StreamId::RELIABLE, &[1]),
        Err(WriteError::Down)
    );
    world.connect();
    world.create_all();
    world.settle();
    assert_eq!(
        world.take_told(),
        ALL.map(|object| Told::Status(object, Status::OK))
    );
    assert_eq!(world.agent.created, ALL);
    assert_eq!(world.session.creation(READER), Some(RequestState::Done));

    world
        .session
        .write(WRITER, StreamId::RELIABLE, &[1; LARGE])
        .unwrap();
    world
        .session
        .write(WRITER, StreamId::BEST_EFFORT, &[2; 100])
        .unwrap();
    assert!(!world.session.is_delivered());
    world.settle();
    assert!(world.session.is_delivered());
    // Best effort does not wait for reliable messages.
    assert_eq!(
        world.agent.written,
        [(WRITER, vec![2; 100]), (WRITER, vec![1; LARGE])]
    );

    let datagrams = world.agent.deliver(world.now, READER, &[7; 20]);
    world.arrive(datagrams);
    assert_eq!(world.take_told(), [Told::Data(READER, vec![7; 20])]);

    let asked = world.session.request_time(WireTime {
        seconds: 1001,
        nanoseconds: 0,
    });
    world.settle();
    if QUERIES {
        assert_eq!(
            (asked, world.take_told()),
            (Ok(()), vec![Told::Time(1_000_000_000)])
        );
    } else {
        assert_eq!(asked, Err(RequestError::Unsupported));
    }

    world.session.delete(WRITER).unwrap();
    world.settle();
    assert_eq!(world.take_told(), [Told::Status(WRITER, Status::OK)]);
    assert_eq!(world.session.creation(WRITER), None);
    world.session.close(world.now);
    world.settle();
    assert_eq!(world.take_told(), [Told::Closed]);
    assert_eq!(world.session.next_deadline(), None);
}

#[test]
fn an_idle_session_pings_and_stays_up() {
    let mut world = World::new();
    world.connect();
    world.run(10 * SECOND);
    assert_eq!(
        (world.take_told(), world.session.state()),
        (vec![], SessionState::Up)
    );
    let pings = world.session.link_stats().pings;
    assert!((60..=72).contains(&pings), "{pings} pings in 10 s");
}

#[test]
fn a_lost_agent_is_noticed_and_everything_comes_back_with_it() {
    let mut world = World::new();
    world.connect();
    world.create_all();
    world.settle();
    world.take_told();
    world.agent_on = false;
    world
        .session
        .write(WRITER, StreamId::RELIABLE, &[1])
        .unwrap();
    world.run(699 * MILLI);
    assert_eq!(world.take_told(), []);
    world.run(2 * MILLI);
    assert_eq!(world.take_told(), [Told::Down]);
    assert_eq!(
        world.session.write(WRITER, StreamId::RELIABLE, &[1]),
        Err(WriteError::Down)
    );
    let stats = world.session.link_stats();
    assert_eq!((stats.losses, stats.unacknowledged), (1, 1));

    world.run(20 * SECOND);
    assert_eq!(world.session.state(), SessionState::Connecting);
    let tries = world.session.link_stats().logins;
    assert!((40..=45).contains(&tries), "{tries} log-ins in 20 s");
    world.agent.restart();
    world.agent_on = true;
    world.run(501 * MILLI);
    let mut expected = ALL.map(|object| Told::Status(object, Status::OK)).to_vec();
    expected.push(Told::Up);
    assert_eq!(world.take_told(), expected);
    assert_eq!(world.agent.created, ALL);
    assert_eq!(world.agent.reads.len(), 1);
    let sessions = &world.agent.sessions;
    assert!(
        sessions.len() == 2 && sessions[0] != sessions[1],
        "{sessions:?}"
    );
    world
        .session
        .write(WRITER, StreamId::RELIABLE, &[5])
        .unwrap();
    world.settle();
    assert_eq!(world.agent.written, [(WRITER, vec![5])]);
}

#[test]
fn a_caller_that_was_away_does_not_lose_the_agent() {
    let mut world = World::new();
    world.connect();
    world.now += 20 * SECOND; // without tick, handle or poll_transmit
    world.run(SECOND);
    assert_eq!(
        (world.take_told(), world.session.link_stats().losses),
        (vec![], 0)
    );
}

#[test]
fn an_agent_that_was_restarted_at_once_is_logged_in_to_again() {
    let mut world = World::new();
    world.connect();
    world.create_all();
    world.settle();
    world.agent.restart();
    world.take_told();
    world.run(1_000 * MILLI);
    let told = world.take_told();
    assert_eq!(
        (told.first(), told.last()),
        (Some(&Told::Down), Some(&Told::Up)),
        "{told:?}"
    );
    assert_eq!(world.agent.created, ALL);
}

#[test]
fn only_the_answer_to_the_latest_login_counts() {
    let mut world = World::new();
    world.session.connect(world.now);
    let first = world.session.poll_transmit(world.now).unwrap().to_vec();
    let answer = world.agent.handle(world.now, &first);
    world.now += 200 * MILLI;
    let second = world.session.poll_transmit(world.now).unwrap().to_vec();
    assert_ne!(first, second);
    // The agent has not got the second one yet, but it will, and then replaces the session.
    world.arrive(answer);
    assert_eq!(world.session.state(), SessionState::Connecting);
    let answer = world.agent.handle(world.now, &second);
    world.arrive(answer.clone());
    assert_eq!(
        (world.session.state(), world.session.id()),
        (SessionState::Up, SessionId(0x82))
    );
    // The network may duplicate it.
    world.create_all();
    world.settle();
    world.arrive(answer);
    assert_eq!(world.session.state(), SessionState::Up);
    assert_eq!(world.session.creation(READER), Some(RequestState::Done));
}

#[test]
fn an_agent_that_does_not_answer_requests_is_not_waited_for_for_ever() {
    let mut world = World::new();
    world.connect();
    world.create_all();
    world.settle();
    world.take_told();
    world.agent.mute = true;
    let another = ObjectId::new(2, ObjectKind::Participant);
    let repr = Representation::Binary(ParticipantBinary::default());
    let entity = Entity::Participant { repr, domain: 0 };
    let mode = CreationMode::REUSE_OR_REPLACE;
    world.session.create(another, mode, &entity).unwrap();
    world.run(4_900 * MILLI);
    assert_eq!(world.session.creation(another), Some(RequestState::Asked));
    world.run(200 * MILLI);
    let unanswered = Some(RequestState::Unanswered);
    assert_eq!(world.session.creation(another), unanswered);
    assert_eq!(world.session.state(), SessionState::Up);
    // Nor after a restart: the session is up, and says what it lacks.
    world.agent.restart();
    world.run(10 * SECOND);
    assert_eq!(world.take_told(), [Told::Down, Told::Up]);
    assert_eq!(world.session.creation(READER), unanswered);
}

#[test]
fn refusals_are_told() {
    let mut world = World::new();
    world.agent.login_status = Status::RESOURCES;
    world.session.connect(world.now);
    world.run(100 * MILLI);
    assert_eq!(world.take_told(), [Told::Refused(Status::RESOURCES)]);
    world.agent.login_status = Status::OK;
    world.agent.create_status = Status::DENIED;
    world.run(SECOND);
    assert_eq!(world.take_told(), [Told::Up]);
    world.create_all();
    world.settle();
    assert_eq!(
        world.session.creation(TOPIC),
        Some(RequestState::Refused(Status::DENIED))
    );
    assert_eq!(
        world.session.creation(ObjectId::new(9, ObjectKind::Topic)),
        None
    );
}

#[test]
fn what_cannot_be_sent_is_refused_with_the_reason() {
    let mut world = World::new();
    world.connect();
    let limit = world.session.limit(StreamId::BEST_EFFORT).unwrap();
    assert_eq!(limit, 512 - 4 - 8);
    world
        .session
        .write(WRITER, StreamId::BEST_EFFORT, &vec![0; limit])
        .unwrap();
    assert_eq!(
        world
            .session
            .write(WRITER, StreamId::BEST_EFFORT, &vec![0; limit + 1]),
        Err(WriteError::TooLarge {
            size: limit + 1,
            limit
        })
    );
    let limit = world.session.limit(StreamId::RELIABLE).unwrap();
    assert_eq!(limit, if FRAGMENTS { 16 * 504 - 8 } else { 508 - 8 });
    assert_eq!(
        world
            .session
            .write(WRITER, StreamId::RELIABLE, &vec![0; limit + 1]),
        Err(WriteError::TooLarge {
            size: limit + 1,
            limit
        })
    );
    for _ in 0..if FRAGMENTS { 1 } else { 16 } {
        world
            .session
            .write(WRITER, StreamId::RELIABLE, &vec![0; limit])
            .unwrap();
    }
    assert_eq!(
        world.session.write(WRITER, StreamId::RELIABLE, &[0]),
        Err(WriteError::WouldBlock)
    );
    let unknown = StreamId(0x81);
    assert_eq!(
        world.session.write(WRITER, unknown, &[0]),
        Err(WriteError::UnknownStream(unknown))
    );
    let group = Entity::Publisher {
        repr: Representation::Binary(GroupBinary::default()),
        participant: PARTICIPANT,
    };
    let mode = CreationMode::REPLACE;
    assert_eq!(
        world.session.create(WRITER, mode, &group),
        Err(RequestError::WrongObject(WRITER))
    );
    if !FRAGMENTS {
        return; // so long a description is refused before the journal is looked at
    }
    let name = "n".repeat(2000);
    let long = Entity::Publisher {
        repr: Representation::Xml(&name),
        participant: PARTICIPANT,
    };
    assert_eq!(
        world.session.create(PUBLISHER, mode, &long),
        Err(RequestError::JournalFull)
    );
    let name = "n".repeat(9000);
    let long = Entity::Publisher {
        repr: Representation::Xml(&name),
        participant: PARTICIPANT,
    };
    let refused = world.session.create(PUBLISHER, mode, &long);
    assert!(
        matches!(
            refused,
            Err(RequestError::Stream(PushError::TooLarge {
                limit: 8064,
                ..
            }))
        ),
        "{refused:?}"
    );
}

#[test]
fn with_a_session_id_below_0x80_the_key_is_in_every_message() {
    let config = Config {
        session: SessionId(0x01),
        ..Config::new(ClientKey([0xa, 0xb, 0xc, 0xd]))
    };
    let mut world = World::with(config);
    world.connect();
    world.create_all();
    world.settle();
    assert_eq!(world.agent.created, ALL);
    world
        .session
        .write(WRITER, StreamId::RELIABLE, &[3; LARGE])
        .unwrap();
    world.settle();
    assert_eq!(world.agent.written, [(WRITER, vec![3; LARGE])]);
    // Another client's message is none of ours.
    let mut datagrams = world.agent.deliver(world.now, READER, &[1]);
    datagrams[0][7] ^= 1;
    world.take_told();
    world.arrive(datagrams);
    assert_eq!(
        (world.take_told(), world.session.link_stats().rejected),
        (vec![], 1)
    );
}

#[test]
fn requests_that_do_not_fit_the_window_follow_later() {
    let mut world = World::new();
    world.connect();
    let limit = world.session.limit(StreamId::RELIABLE).unwrap();
    let fill = vec![0; limit];
    let mut write = || world.session.write(WRITER, StreamId::RELIABLE, &fill);
    while write() != Err(WriteError::WouldBlock) {}
    world.create_all();
    assert_eq!(world.session.creation(READER), Some(RequestState::Queued));
    world.run(100 * MILLI);
    assert_eq!(world.session.creation(READER), Some(RequestState::Done));
    assert_eq!(world.agent.created, ALL);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3_000, ..ProptestConfig::default() })]

    #[test]
    fn no_agent_makes_the_session_panic(
        datagrams in prop::collection::vec(
            (0_u8..3, 0_u16..40, prop::collection::vec(
                (0_u8..17, any::<u8>(), prop::collection::vec(any::<u8>(), 0..40)), 0..3)),
            0..40,
        ),
        steps in prop::collection::vec(0_u64..SECOND, 0..40),
    ) {
        let mut world = World::new();
        world.connect();
        world.create_all();
        world.settle();
        for ((stream, seq, submessages), step) in datagrams.into_iter().zip(steps) {
            let session = world.session.id().0;
            let stream = [0x00, 0x01, 0x80][usize::from(stream)];
            let mut bytes = vec![session, stream];
            bytes.extend(seq.to_le_bytes());
            for (id, flags, body) in submessages {
                bytes.extend([id, flags]);
                bytes.extend(u16::try_from(body.len()).unwrap().to_le_bytes());
                bytes.extend(&body);
                bytes.resize(bytes.len().next_multiple_of(4), 0);
            }
            world.arrive(vec![bytes]);
            world.agent_on = step % 2 == 0;
            world.now += step;
            world.session.tick(world.now, &mut |_| ());
            while world.session.poll_transmit(world.now).is_some() {}
            std::hint::black_box(world.session.write(WRITER, StreamId::RELIABLE, &[1; 600]).is_ok());
        }
    }
}
