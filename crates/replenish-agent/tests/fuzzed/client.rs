//! A client session with two streams of each kind that gets any datagrams at any time, besides
//! those of an agent, while its application goes on.

use super::{MS, Script};
use replenish_xrce::SeqNum;
use replenish_xrce::client::{Buffers, Config, Event, ReliableBuffers, Session, SessionState};
use replenish_xrce::wire::{
    AckNack, AgentInfo, Body, ClientKey, CreationMode, DataReaderBinary, DataWriterBinary,
    DeliveryControl, Encode, Entity, GroupBinary, Header, Info, Message, MessageWriter, ObjectId,
    ObjectKind, ParticipantBinary, Properties, Representation, SampleIdentity, ServiceBinary,
    SessionId, Status, StatusAgent, StatusReply, StreamId, TimestampReply, TopicBinary, VENDOR,
    VERSION, WireTime,
};
use std::collections::BTreeMap;

const MTU: usize = 256;
const SLOTS: usize = 8;
const KEY: ClientKey = ClientKey([9; 4]);
/// Best effort, best effort, reliable, reliable.
const STREAMS: [StreamId; 4] = [StreamId(1), StreamId(2), StreamId(0x80), StreamId(0x81)];

/// A session under fire, with an agent that answers at once if its messages get through.
pub(crate) struct Client {
    session: Session<Vec<u8>, SLOTS, 24, 2, 2>,
    agent: Answers,
    now: u64,
    /// Identity of the last request that arrived, for the next reply.
    asked: SampleIdentity,
    created: u16,
    pub(crate) samples: u64,
}

impl Client {
    /// A session that logs in, with one entity of every kind.
    pub(crate) fn new() -> Self {
        let config = Config {
            mtu: MTU as u16,
            ..Config::new(KEY)
        };
        let reliable = || ReliableBuffers {
            output: vec![0; SLOTS * MTU],
            large_output: vec![0; 1200],
            input: vec![0; SLOTS * MTU],
            fragments: vec![0; 1000],
        };
        let buffers = Buffers {
            best_effort: [vec![0; MTU], vec![0; MTU]],
            reliable: [reliable(), reliable()],
            journal: vec![0; 1000],
            restore: vec![0; 2 * MTU],
        };
        let mut client = Self {
            session: Session::new(config, buffers),
            agent: Answers::default(),
            now: 0,
            asked: SampleIdentity([0; 24]),
            created: 1,
            samples: 0,
        };
        client.create(1);
        client.session.connect(0);
        client
    }

    /// Carries out a script from its beginning.
    pub(crate) fn run(script: &[u8]) {
        let mut client = Self::new();
        let mut script = Script(script);
        while !script.is_empty() {
            client.step(&mut script);
        }
        client.end();
    }

    /// One step: an operation, and what belongs to it. A datagram comes with its length before it.
    pub(crate) fn step(&mut self, script: &mut Script<'_>) {
        let op = script.byte();
        let mut answered = false;
        match op % 8 {
            0 => self.handle(script.run()),
            1 | 2 => {
                let bytes = self.in_order(script.run());
                self.handle(&bytes);
            }
            3 => answered = true,
            4 => self.now += MS * u64::from(script.byte()),
            5 => {
                let time = u64::from(script.byte());
                self.now += MS * time * time / 16;
            }
            _ => self.act(op / 8, script),
        }
        self.drain(answered);
    }

    /// The same for the current session, with the number that is due on its stream, so that it is
    /// not dropped for that.
    fn in_order(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        if let [session, stream, low, high, ..] = &mut bytes[..] {
            *session = self.session.id().0;
            if *stream > 0 {
                let next = self.agent.next_out.entry(*stream).or_default();
                [*low, *high] = next.to_le_bytes();
                *next = next.wrapping_add(u16::from(*stream < 0x80));
            }
        }
        bytes
    }

    fn handle(&mut self, bytes: &[u8]) {
        let (asked, samples) = (&mut self.asked, &mut self.samples);
        self.session
            .handle(self.now, bytes, &mut |event| match event {
                Event::Request { identity, .. } => *asked = identity,
                Event::Data { payload, .. } => {
                    assert!(payload.len() <= u16::MAX.into());
                    *samples += 1;
                }
                _ => {}
            });
    }

    /// Something that an application does.
    fn act(&mut self, what: u8, script: &mut Script<'_>) {
        let argument = script.byte();
        let stream = STREAMS[usize::from(argument % 4)];
        let payload = [argument; 1100];
        let payload = &payload[..usize::from(argument) * 4];
        let id = |kind| ObjectId::new(1, kind);
        match what % 10 {
            0..=2 => may_fail(
                self.session
                    .write(id(ObjectKind::DataWriter), stream, payload),
            ),
            3 => may_fail(
                self.session
                    .request(id(ObjectKind::Requester), stream, payload),
            ),
            4 => {
                let (replier, identity) = (id(ObjectKind::Replier), self.asked);
                may_fail(self.session.reply(replier, stream, identity, payload));
            }
            5 => {
                self.created = self.created % 3 + 1;
                self.create(self.created);
            }
            6 => {
                let number = u16::from(argument % 4);
                may_fail(
                    self.session
                        .delete(ObjectId::new(number, ObjectKind::DataReader)),
                );
            }
            7 => may_fail(self.session.request_info(u32::from(argument))),
            8 => may_fail(self.session.request_time(WireTime::from_nanos(1))),
            _ if argument < 128 => self.session.disconnected(self.now, &mut |_| {}),
            _ if argument < 192 => self.session.close(self.now),
            _ => self.session.connect(self.now),
        }
    }

    /// One entity of every kind with this number; there may be no room for them.
    fn create(&mut self, number: u16) {
        let id = |kind| ObjectId::new(number, kind);
        let (participant, topic) = (id(ObjectKind::Participant), id(ObjectKind::Topic));
        let (publisher, subscriber) = (id(ObjectKind::Publisher), id(ObjectKind::Subscriber));
        let group = || Representation::Binary(GroupBinary::default());
        let service = ServiceBinary {
            service: "s",
            request_type: "Q",
            reply_type: "R",
            request_topic: None,
            reply_topic: None,
        };
        let named = TopicBinary {
            name: "t",
            type_reference: None,
            type_name: Some("T"),
        };
        for entity in [
            Entity::Participant {
                repr: Representation::Binary(ParticipantBinary::default()),
                domain: 0,
            },
            Entity::Topic {
                repr: Representation::Binary(named),
                participant,
            },
            Entity::Publisher {
                repr: group(),
                participant,
            },
            Entity::Subscriber {
                repr: group(),
                participant,
            },
            Entity::DataWriter {
                repr: Representation::Binary(DataWriterBinary { topic, qos: None }),
                publisher,
            },
            Entity::DataReader {
                repr: Representation::Binary(DataReaderBinary { topic, qos: None }),
                subscriber,
            },
            Entity::Requester {
                repr: Representation::Binary(service),
                participant,
            },
            Entity::Replier {
                repr: Representation::Binary(service),
                participant,
            },
        ] {
            let object = id(entity.kind());
            let mode = CreationMode::REUSE_OR_REPLACE;
            may_fail(self.session.create(object, mode, &entity));
        }
        for (kind, stream) in [
            (ObjectKind::DataReader, StreamId(0x81)),
            (ObjectKind::Requester, StreamId(0x80)),
            (ObjectKind::Replier, StreamId(1)),
        ] {
            let control = DeliveryControl::UNLIMITED;
            may_fail(self.session.read(id(kind), stream, control));
        }
    }

    /// Sends until there is nothing more to send, which must come soon; what is sent is answered
    /// or lost.
    fn drain(&mut self, answered: bool) {
        let mut sent = 0;
        loop {
            self.session.tick(self.now, &mut |_| {});
            let Some(datagram) = self.session.poll_transmit(self.now) else {
                break;
            };
            assert!((4..=MTU).contains(&datagram.len()), "{datagram:02x?}");
            sent += 1;
            assert!(sent < 2_000, "no end");
            self.agent.notice(datagram);
            if answered {
                for answer in self.agent.to(datagram) {
                    self.handle(&answer);
                }
            }
        }
        // The slots, and the pieces of a large sample that waits for slots.
        assert!(self.session.unacknowledged() <= 2 * (SLOTS + 6));
        // Nothing is left undone, or this would be asked for again without end.
        let next = self.session.next_deadline();
        assert!(next.is_none_or(|at| at > self.now), "{next:?}");
    }

    /// With an agent that answers and no other peer, the session comes up and samples get through,
    /// as if nothing had been.
    pub(crate) fn end(&mut self) {
        self.session.disconnected(self.now, &mut |_| {});
        let pass = |client: &mut Self, done: fn(&Self) -> bool| {
            let end = client.now + 20_000 * MS;
            while !done(client) {
                client.session.connect(client.now);
                client.drain(true);
                assert!(client.now < end, "{:?}", client.session.state());
                let next = client.session.next_deadline();
                client.now = next.unwrap_or(end).min(client.now + 50 * MS);
            }
        };
        pass(self, |client| client.session.state() == SessionState::Up);
        for stream in STREAMS {
            let writer = ObjectId::new(1, ObjectKind::DataWriter);
            // Samples written before the agent was lost may fill the stream.
            may_fail(self.session.write(writer, stream, b"sample"));
        }
        pass(self, |client| client.session.is_delivered());
    }
}

/// There may be no session, no room, no such stream.
fn may_fail<T, E>(_: Result<T, E>) {}

/// An agent that accepts everything, without memory but for numbers.
#[derive(Default)]
struct Answers {
    session: u8,
    next_in: BTreeMap<u8, u16>,
    next_out: BTreeMap<u8, u16>,
}

impl Answers {
    /// Notes the messages that have reached the session: its acknowledgements name them.
    fn notice(&mut self, datagram: &[u8]) {
        let message = Message::parse(datagram).expect("the session sends messages");
        for submessage in message.submessages() {
            let submessage = submessage.expect("a submessage");
            if let Body::AckNack(ack) = submessage.body().expect("a body") {
                self.next_out.insert(ack.stream.0, ack.first_unacked.0);
            }
        }
    }

    fn to(&mut self, datagram: &[u8]) -> Vec<Vec<u8>> {
        let message = Message::parse(datagram).expect("the session sends messages");
        let (stream, mut out) = (message.header.stream, Vec::new());
        let mut in_order = true;
        if stream.is_reliable() {
            let next = self.next_in.entry(stream.0).or_default();
            in_order = message.header.seq.0 == *next;
            *next = next.wrapping_add(u16::from(in_order));
            out.push(self.acknack(stream));
        }
        for submessage in message.submessages().filter(|_| in_order) {
            let submessage = submessage.expect("a submessage");
            self.answer(&submessage.body().expect("a body"), stream, &mut out);
        }
        out
    }

    fn acknack(&self, stream: StreamId) -> Vec<u8> {
        let next = self.next_in.get(&stream.0).copied().unwrap_or(0);
        let acknack = AckNack {
            first_unacked: SeqNum(next),
            missing: 0,
            stream,
        };
        self.message(StreamId::NONE, 0, &acknack)
    }

    fn answer(&mut self, body: &Body<'_>, on: StreamId, out: &mut Vec<Vec<u8>>) {
        let status = |base| StatusReply {
            base,
            status: Status::OK,
            implementation: 0,
        };
        match body {
            Body::CreateClient(create) => {
                *self = Self {
                    session: create.session.0,
                    ..Self::default()
                };
                let answer = StatusAgent {
                    status: Status::OK,
                    implementation: 0,
                    version: VERSION,
                    vendor: VENDOR,
                    properties: Properties::None,
                };
                out.push(self.message(StreamId::NONE, 0, &answer));
            }
            Body::Delete(delete) if delete.base.object == ObjectId::CLIENT => {
                out.push(self.message(StreamId::NONE, 0, &status(delete.base)));
            }
            Body::Create(create) => self.reliably(&status(create.base), out),
            Body::Delete(delete) => self.reliably(&status(delete.base), out),
            Body::GetInfo(get) => {
                let info = Info {
                    base: get.base,
                    status: Status::OK,
                    implementation: 0,
                    agent: Some(AgentInfo {
                        version: VERSION,
                        vendor: VENDOR,
                    }),
                    availability: Some(1),
                };
                out.push(self.message(StreamId::NONE, 0, &info));
            }
            Body::Timestamp(timestamp) => {
                let reply = TimestampReply {
                    transmit: timestamp.transmit,
                    receive: timestamp.transmit,
                    originate: timestamp.transmit,
                };
                out.push(self.message(StreamId::NONE, 0, &reply));
            }
            Body::Heartbeat(heartbeat) => out.push(self.acknack(heartbeat.stream)),
            Body::WriteData(_) | Body::ReadData(_) | Body::AckNack(_) | Body::Fragment(_) => {}
            other => panic!("{other:?} on {on:?}"),
        }
    }

    fn reliably(&mut self, body: &impl Encode, out: &mut Vec<Vec<u8>>) {
        let next = self.next_out.entry(0x80).or_default();
        let seq = *next;
        *next = next.wrapping_add(1);
        out.push(self.message(StreamId(0x80), seq, body));
    }

    fn message(&self, stream: StreamId, seq: u16, body: &impl Encode) -> Vec<u8> {
        let mut buf = [0; 256];
        let header = Header::new(SessionId(self.session), stream, SeqNum(seq), KEY);
        let mut message = MessageWriter::new(&mut buf, &header).unwrap();
        message.push(body).unwrap();
        message.finish().to_vec()
    }
}
