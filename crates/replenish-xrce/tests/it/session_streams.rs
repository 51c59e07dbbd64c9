//! Several streams of a session, samples that outlive the loss of the agent, services, and what a
//! log-in carries; in virtual time, against a scripted agent.

use crate::fake_agent::FakeAgent;
use replenish_xrce::Nanos;
use replenish_xrce::client::{
    Buffers, Config, Event, PING_LEN, ReliableBuffers, RequestError, Session, SessionState,
    WriteError, ping, pong,
};
use replenish_xrce::features::FRAGMENTS;
use replenish_xrce::stream::{AckPolicy, PushError};
use replenish_xrce::wire::{
    ClientKey, CreationMode, DataWriterBinary, DeliveryControl, Entity, INFO_CONFIGURATION,
    Message, ObjectId, ObjectKind, Properties, Representation, RequestId, SampleIdentity,
    SessionId, StreamId, SubmessageId,
};

const MTU: usize = 128;
const MILLI: Nanos = 1_000_000;
const SECOND: Nanos = 1_000_000_000;
const WRITER: ObjectId = ObjectId::new(1, ObjectKind::DataWriter);
const READER: ObjectId = ObjectId::new(1, ObjectKind::DataReader);
const REQUESTER: ObjectId = ObjectId::new(2, ObjectKind::Requester);
const REPLIER: ObjectId = ObjectId::new(3, ObjectKind::Replier);

type Client = Session<Vec<u8>, 16, 16, 2, 2>;

fn client(config: Config, large: usize, restore: usize) -> Client {
    let reliable = || ReliableBuffers {
        output: vec![0; 8 * MTU],
        large_output: vec![0; large],
        input: vec![0; 8 * MTU],
        fragments: vec![0; 60_000],
    };
    Session::new(
        config,
        Buffers {
            best_effort: [vec![0; MTU], vec![0; MTU]],
            reliable: [reliable(), reliable()],
            journal: vec![0; 1024],
            restore: vec![0; restore],
        },
    )
}

fn config() -> Config {
    Config {
        mtu: MTU as u16,
        ..Config::new(ClientKey([1, 2, 3, 4]))
    }
}

struct World {
    session: Client,
    agent: FakeAgent,
    now: Nanos,
    on: bool,
    /// Every datagram to the agent.
    sent: Vec<Vec<u8>>,
    data: Vec<Vec<u8>>,
}

impl World {
    fn new(session: Client) -> Self {
        let mut world = World {
            session,
            agent: FakeAgent::new(),
            now: SECOND,
            on: true,
            sent: Vec::new(),
            data: Vec::new(),
        };
        world.session.connect(world.now);
        world.settle();
        assert_eq!(world.session.state(), SessionState::Up);
        world.sent.clear();
        world
    }

    fn arrive(&mut self, datagrams: Vec<Vec<u8>>) {
        for datagram in datagrams {
            self.session.handle(self.now, &datagram, &mut |event| {
                if let Event::Data { payload, .. } = event {
                    self.data.push(payload.to_vec());
                }
            });
        }
    }

    fn settle(&mut self) {
        self.session.tick(self.now, &mut |_| ());
        while let Some(datagram) = self.session.poll_transmit(self.now).map(<[u8]>::to_vec) {
            self.sent.push(datagram.clone());
            if self.on {
                let answers = self.agent.handle(self.now, &datagram);
                self.arrive(answers);
            }
        }
    }

    fn run(&mut self, duration: Nanos) {
        let end = self.now + duration;
        self.settle();
        while let Some(next) = self.session.next_deadline().filter(|next| *next <= end) {
            self.now = self.now.max(next);
            self.settle();
        }
        self.now = end;
        self.settle();
    }

    /// Kills the agent, waits until that is noticed, starts another.
    fn restart(&mut self) {
        self.on = false;
        self.run(SECOND);
        assert_eq!(self.session.state(), SessionState::Connecting);
        self.agent.restart();
        self.on = true;
    }

    fn write(&mut self, stream: StreamId, payload: &[u8]) -> Result<(), WriteError> {
        self.session.write(WRITER, stream, payload)
    }

    fn written(&self) -> Vec<Vec<u8>> {
        self.agent.written.iter().map(|(_, p)| p.clone()).collect()
    }

    fn create(&mut self, names: usize) {
        for i in 1..=names {
            let object = ObjectId::new(i as u16, ObjectKind::Participant);
            let repr = Representation::Xml("a name that takes some room in a message");
            self.session
                .create(
                    object,
                    CreationMode::REUSE_OR_REPLACE,
                    &Entity::Participant { repr, domain: 0 },
                )
                .unwrap();
        }
    }
}

/// Messages that the reliable streams carried, in order.
fn requests(sent: &[Vec<u8>]) -> Vec<SubmessageId> {
    sent.iter()
        .filter(|d| stream_of(d).is_reliable())
        .flat_map(|d| {
            let message = Message::parse(d).unwrap();
            let ids: Vec<_> = message.submessages().map(|s| s.unwrap().id).collect();
            ids
        })
        .collect()
}

fn stream_of(datagram: &[u8]) -> StreamId {
    Message::parse(datagram).unwrap().header.stream
}

#[test]
fn a_backlog_of_one_stream_does_not_delay_another() {
    let mut world = World::new(client(config(), 0, MTU));
    let (bulk, urgent) = (StreamId::reliable(0), StreamId::reliable(1));
    world.on = false;
    let mut count = 0;
    while world.write(bulk, &[1; 100]) == Ok(()) {
        count += 1;
    }
    assert_eq!(count, 8, "the ring of the first stream is full");
    assert_eq!(world.write(bulk, &[1; 100]), Err(WriteError::WouldBlock));
    world.write(urgent, &[2; 100]).unwrap();
    world.write(StreamId::best_effort(0), &[3; 100]).unwrap();
    world.write(StreamId::best_effort(1), &[4; 100]).unwrap();
    world.settle();
    let order: Vec<u8> = world.sent.iter().map(|d| stream_of(d).0).collect();
    assert_eq!(order[..4], [0x02, 0x01, 0x81, 0x80]);
    // Lost, all of them; the other stream's repair does not wait for the first one's either.
    world.on = true;
    world.run(50 * MILLI);
    let written = world.written();
    assert_eq!(written.iter().filter(|p| p[0] == 1).count(), 8);
    assert_eq!(written.iter().filter(|p| p[0] == 2).count(), 1);
    let stats = |stream| world.session.stream_stats(stream).unwrap().0;
    assert_eq!((stats(bulk).sent, stats(urgent).sent), (8, 1));
    assert_eq!(world.session.stream_stats(StreamId::reliable(2)), None);
}

#[test]
#[cfg_attr(not(feature = "fragments"), ignore = "needs the feature `fragments`")]
fn samples_larger_than_the_ring_go_out_in_fragments_as_there_is_room() {
    let mut world = World::new(client(config(), 50_008, MTU));
    assert_eq!(world.session.limit(StreamId::RELIABLE), Some(50_000));
    let sample: Vec<u8> = (0..50_000_u32).map(|i| (i * 7) as u8).collect();
    let largest = world.write(StreamId::RELIABLE, &vec![0; 50_001]);
    assert!(matches!(
        largest,
        Err(WriteError::TooLarge { limit: 50_000, .. })
    ));
    world.write(StreamId::RELIABLE, &[9; 10]).unwrap();
    world.write(StreamId::RELIABLE, &sample).unwrap();
    assert_eq!(
        world.write(StreamId::RELIABLE, &[1]),
        Err(WriteError::WouldBlock)
    );
    world.run(100 * MILLI);
    assert!(world.session.is_delivered());
    world.write(StreamId::RELIABLE, &[1]).unwrap();
    world.settle();
    assert_eq!(world.written(), [vec![9; 10], sample, vec![1]]);
}

#[test]
#[cfg_attr(not(feature = "delivery"), ignore = "needs the feature `delivery`")]
fn what_was_not_acknowledged_is_sent_again_to_the_next_agent_once() {
    let mut world = World::new(client(config(), 4_008, MTU));
    world.create(5);
    world.settle();
    world.write(StreamId::RELIABLE, b"acknowledged").unwrap();
    world.settle();
    world.on = false;
    world.create(6); // a request in one message with samples: it is in the journal, too
    world.write(StreamId::RELIABLE, b"small").unwrap();
    world.write(StreamId::RELIABLE, b"packed").unwrap();
    let fragments = vec![7; 300];
    world.write(StreamId::RELIABLE, &fragments).unwrap();
    let large = vec![8; 4_000];
    world.write(StreamId::RELIABLE, &large).unwrap();
    world.write(StreamId::reliable(1), b"other").unwrap();
    world.restart();
    world.sent.clear();
    world.run(2 * SECOND);
    assert_eq!(world.session.state(), SessionState::Up);
    let stats = world.session.link_stats();
    assert_eq!((stats.carried, stats.lost), (5, 0), "{stats:?}");
    let mut written = world.written();
    written.sort();
    let mut expected = [
        b"acknowledged".to_vec(),
        b"small".to_vec(),
        b"packed".to_vec(),
        fragments,
        large,
        b"other".to_vec(),
    ];
    expected.sort();
    assert_eq!(written, expected);
    assert_eq!(world.agent.created.len(), 6);
    assert!(world.session.is_delivered());
    // The objects come before the samples.
    let ids = requests(&world.sent);
    let last_create = ids.iter().rposition(|id| *id == SubmessageId::Create);
    let first_sample = ids.iter().position(|id| *id != SubmessageId::Create);
    assert!(last_create.unwrap() < first_sample.unwrap(), "{ids:?}");
}

#[test]
#[cfg_attr(not(feature = "delivery"), ignore = "needs the feature `delivery`")]
fn a_writer_that_goes_without_an_agent_is_deleted_behind_its_last_sample() {
    let mut world = World::new(client(config(), 0, MTU));
    let publisher = ObjectId::new(1, ObjectKind::Publisher);
    let writer = DataWriterBinary {
        topic: ObjectId::new(1, ObjectKind::Topic),
        qos: None,
    };
    let repr = Representation::Binary(writer);
    let entity = Entity::DataWriter { repr, publisher };
    let mode = CreationMode::REUSE_OR_REPLACE;
    world.session.create(WRITER, mode, &entity).unwrap();
    world.run(100 * MILLI);
    world.on = false;
    world.write(StreamId::reliable(1), b"last").unwrap();
    world.restart();
    world.sent.clear();
    let blocked = Err(RequestError::Stream(PushError::WouldBlock));
    let delete = |world: &mut World| world.session.delete_behind(WRITER, StreamId::reliable(1));
    assert_eq!(delete(&mut world), blocked);
    while world.session.state() != SessionState::Up {
        assert_eq!(delete(&mut world), blocked);
        world.run(MILLI);
    }
    while delete(&mut world).is_err() {
        world.run(MILLI);
    }
    world.run(SECOND);
    assert_eq!(world.written(), [b"last"]);
    assert_eq!(world.agent.created, []);
    let [create, write, end] = [
        SubmessageId::Create,
        SubmessageId::WriteData,
        SubmessageId::Delete,
    ];
    assert_eq!(requests(&world.sent), [create, write, end]);
    // Where nothing waits it is forgotten at once.
    world.session.create(WRITER, mode, &entity).unwrap();
    world.run(100 * MILLI);
    world.restart();
    assert_eq!(delete(&mut world), Ok(()));
    world.run(2 * SECOND);
    assert_eq!(world.agent.created, []);
}

#[test]
#[cfg_attr(not(feature = "delivery"), ignore = "needs the feature `delivery`")]
fn a_sample_of_which_some_fragments_were_acknowledged_is_sent_again_whole() {
    for large in [0, 2_000] {
        let mut world = World::new(client(config(), large, MTU));
        let sample: Vec<u8> = (0..700_u32).map(|i| i as u8).collect();
        world.write(StreamId::RELIABLE, &sample).unwrap();
        // Two of the fragments arrive and are acknowledged.
        for _ in 0..2 {
            let datagram = world.session.poll_transmit(world.now).unwrap().to_vec();
            let answers = world.agent.handle(world.now, &datagram);
            world.arrive(answers);
        }
        world.restart();
        world.run(2 * SECOND);
        assert_eq!(world.written(), [sample]);
        // Twice over.
        world.write(StreamId::RELIABLE, &[1; 300]).unwrap();
        world.restart();
        world.run(2 * SECOND);
        assert_eq!(world.written().len(), 2);
    }
}

#[test]
fn without_room_for_that_the_loss_is_counted() {
    let mut world = World::new(client(config(), 0, 0));
    world.on = false;
    world.write(StreamId::RELIABLE, b"one").unwrap();
    world.settle(); // messages are counted where samples cannot be
    let large = if FRAGMENTS { 200 } else { 100 };
    world.write(StreamId::RELIABLE, &vec![2; large]).unwrap();
    world.restart();
    world.run(2 * SECOND);
    let stats = world.session.link_stats();
    assert_eq!((stats.carried, stats.lost), (0, 2));
    assert_eq!(world.written(), [[]; 0]);
    world.on = false;
    world.write(StreamId::RELIABLE, b"three").unwrap();
    world.session.close(world.now);
    assert_eq!(world.session.link_stats().lost, 3);
}

#[test]
#[cfg_attr(not(feature = "services"), ignore = "needs the feature `services`")]
fn requests_and_replies_carry_who_asked_what() {
    let mut world = World::new(client(config(), 0, MTU));
    for (object, stream) in [(REQUESTER, 0), (REPLIER, 0)] {
        let stream = StreamId::reliable(stream);
        world
            .session
            .read(object, stream, DeliveryControl::UNLIMITED)
            .unwrap();
    }
    world.settle();
    let asked = world
        .session
        .request(REQUESTER, StreamId::RELIABLE, b"2 + 2")
        .unwrap();
    let identity = SampleIdentity(*b"guid of sixteen.number 8");
    world
        .session
        .reply(REPLIER, StreamId::RELIABLE, identity, b"4")
        .unwrap();
    world.settle();
    let reply = [&identity.0[..], b"4"].concat();
    let written = [(REQUESTER, b"2 + 2".to_vec()), (REPLIER, reply.clone())];
    assert_eq!(world.agent.written, written);

    let [high, low] = asked.0.to_be_bytes();
    let [object_high, object_low] = REQUESTER.to_bytes();
    let answer = [high, low, object_high, object_low, b'4'];
    let mut datagrams = world.agent.deliver(world.now, REQUESTER, &answer);
    datagrams.extend(world.agent.deliver(world.now, REPLIER, &reply));
    datagrams.extend(world.agent.deliver(world.now, REPLIER, b"short"));
    let mut told = Vec::new();
    for datagram in datagrams {
        world.session.handle(world.now, &datagram, &mut |event| {
            told.push(format!("{event:?}"));
        });
    }
    let expected = [
        Event::Reply {
            requester: REQUESTER,
            request: asked,
            payload: b"4",
        },
        Event::Request {
            replier: REPLIER,
            identity,
            payload: b"4",
        },
    ];
    assert_eq!(told, expected.map(|event| format!("{event:?}")));
    assert_eq!(world.session.link_stats().malformed, 1);
}

#[test]
#[cfg_attr(not(feature = "delivery"), ignore = "needs the feature `delivery`")]
fn a_login_carries_properties_and_may_reuse_the_session() {
    const LONG: &str = "0123456789012345678901234567890123456789012345678901234567890123456789";
    let properties = Properties::List(&[("uxr_p", "1"), ("site", "roof")]);
    let config = Config {
        properties,
        reuse: true,
        ..config()
    };
    let mut world = World::new(client(config, 0, MTU));
    let expected = [("uxr_p", "1"), ("site", "roof")];
    assert_eq!(
        world.agent.properties,
        expected.map(|(n, v)| (n.to_string(), v.to_string()))
    );
    world.restart();
    world.run(2 * SECOND);
    assert_eq!(world.agent.sessions, [SessionId(0x81); 2]);

    let properties = Properties::List(&[(LONG, LONG), (LONG, LONG), (LONG, LONG), (LONG, LONG)]);
    let config = Config {
        properties,
        ..config
    };
    let world = World::new(client(config, 0, MTU));
    assert_eq!(world.agent.properties, []);
    assert_eq!(world.session.link_stats().properties_omitted, 1);
}

#[test]
fn acknowledgements_are_batched_but_a_gap_is_told_at_once() {
    let acks = AckPolicy {
        every: 4,
        delay: 5 * MILLI,
    };
    let mut world = World::new(client(Config { acks, ..config() }, 0, MTU));
    world
        .session
        .read(READER, StreamId::RELIABLE, DeliveryControl::UNLIMITED)
        .unwrap();
    world.settle();
    world.sent.clear();
    let mut datagrams = Vec::new();
    for i in 0..11_u8 {
        datagrams.extend(world.agent.deliver(world.now, READER, &[i]));
    }
    let missing = datagrams.remove(9);
    world.on = false; // the agent does not hear of the gap, so that it does not repair it
    for datagram in datagrams {
        world.arrive(vec![datagram]);
        world.settle();
    }
    // After four, after eight, and for the gap.
    assert_eq!(world.sent.len(), 3, "{:02x?}", world.sent);
    world.arrive(vec![missing]);
    world.settle();
    assert_eq!(world.sent.len(), 3);
    world.on = true;
    world.run(5 * MILLI);
    assert_eq!(world.sent.len(), 4);
    assert!(world.agent.is_idle());
    assert_eq!(world.data, (0..11_u8).map(|i| vec![i]).collect::<Vec<_>>());
}

#[test]
#[cfg_attr(not(feature = "queries"), ignore = "needs the feature `queries`")]
fn pings_work_without_and_within_a_session() {
    let mut world = World::new(client(config(), 0, MTU));
    world.session.request_info(INFO_CONFIGURATION).unwrap();
    let datagram = world.session.poll_transmit(world.now).unwrap().to_vec();
    let answers = world.agent.handle(world.now, &datagram);
    let mut version = None;
    for answer in answers {
        world.session.handle(world.now, &answer, &mut |event| {
            if let Event::Info(info) = event {
                version = info.agent.map(|agent| agent.version);
            }
        });
    }
    assert_eq!(version, Some([1, 0]));

    let mut buf = [0; PING_LEN];
    let bytes = ping(RequestId(10), None, &mut buf).unwrap();
    // As eProsima's client asks.
    assert_eq!(
        bytes,
        [0x80, 0, 0, 0, 2, 1, 8, 0, 0, 10, 0xff, 0xfd, 2, 0, 0, 0]
    );
    let answer = [
        0x80, 0, 0, 0, 6, 1, 16, 0, 0, 10, 0xff, 0xfd, 0, 0, 0, 1, 0x0d, 0, 1, 0, 0, 0, 0, 0,
    ];
    assert!(pong(RequestId(10), &answer).is_some());
    assert!(pong(RequestId(11), &answer).is_none());
    let key = ClientKey([1, 2, 3, 4]);
    let bytes = ping(RequestId(10), Some(key), &mut buf).unwrap();
    assert_eq!(bytes[..8], [0, 0, 0, 0, 1, 2, 3, 4]);
}
