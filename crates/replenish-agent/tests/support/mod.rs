//! A client that is spelled out: every message is sent by hand over a perfect link, and every
//! datagram of the agent is decoded into what the test then asserts.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]
#![allow(dead_code, reason = "every test binary uses its own part")]

use replenish_agent::{AgentConfig, AgentCore, Limits, Now};
use replenish_xrce::SeqNum;
use replenish_xrce::stream::InputReliable;
use replenish_xrce::wire::{
    AckNack, BaseRequest, ClientKey, Create, CreateClient, CreationMode, DataReaderBinary,
    DataWriterBinary, Delete, DeliveryControl, Encode, EndpointQos, Entity, GroupBinary, Header,
    Message, MessageWriter, ObjectId, ObjectKind, ParticipantBinary, Properties,
    QOS_HISTORY_KEEP_LAST, QOS_RELIABLE, ReadData, ReaderQos, Representation, RequestId,
    ServiceBinary, SessionId, Status, StreamId, SubmessageId, TopicBinary, VENDOR, VERSION,
    WriteData, WriterQos,
};
use replenish_xrce::wire::{Body, Submessages};
use std::collections::BTreeMap;

pub(crate) const MS: u64 = 1_000_000;
pub(crate) const MTU: u16 = 512;

/// An agent's message, decoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Got {
    Agent(Status),
    Status(RequestId, ObjectId, Status),
    Data(ObjectId, Vec<u8>),
    Ack(SeqNum, u16),
    Heartbeat(SeqNum, SeqNum),
    Other(SubmessageId),
}

/// An agent, and the datagrams it has sent that no test has looked at yet.
pub(crate) struct World {
    pub(crate) agent: AgentCore<u32>,
    pub(crate) now: u64,
    pub(crate) sent: Vec<(u32, Vec<u8>)>,
    /// Bytes from each peer, and to it.
    pub(crate) bytes: BTreeMap<u32, (usize, usize)>,
}

impl World {
    pub(crate) fn new(limits: Limits) -> Self {
        Self {
            agent: AgentCore::new(limits),
            now: 0,
            sent: Vec::new(),
            bytes: BTreeMap::new(),
        }
    }

    pub(crate) fn with(config: &AgentConfig) -> Self {
        Self {
            agent: AgentCore::with(config),
            ..Self::new(config.limits)
        }
    }

    /// Lets time pass and the agent do what is due.
    pub(crate) fn pass(&mut self, nanos: u64) {
        self.now += nanos;
        self.pump();
    }

    pub(crate) fn deliver(&mut self, peer: u32, bytes: &[u8]) {
        self.bytes.entry(peer).or_default().0 += bytes.len();
        self.agent.receive(self.at(), peer, bytes);
        self.pump();
    }

    fn pump(&mut self) {
        let now = self.at();
        let (sent, counts) = (&mut self.sent, &mut self.bytes);
        while self.agent.pump(now, 7, &mut |to, bytes| {
            counts.entry(*to).or_default().1 += bytes.len();
            sent.push((*to, bytes.to_vec()));
        }) {}
    }

    pub(crate) fn at(&self) -> Now {
        Now {
            monotonic: self.now,
            unix: 0,
        }
    }

    /// Takes the datagrams for `peer`.
    pub(crate) fn take(&mut self, peer: u32) -> Vec<Vec<u8>> {
        let (mine, others): (Vec<_>, Vec<_>) = std::mem::take(&mut self.sent)
            .into_iter()
            .partition(|(to, _)| *to == peer);
        self.sent = others;
        mine.into_iter().map(|(_, bytes)| bytes).collect()
    }
}

/// A client at `peer`.
pub(crate) struct Client {
    pub(crate) peer: u32,
    pub(crate) key: ClientKey,
    pub(crate) session: SessionId,
    pub(crate) mtu: u16,
    next_seq: u16,
    next_loose: u16,
    next_request: u16,
    /// Puts the messages of the agent's reliable stream in order.
    input: InputReliable<Vec<u8>, Vec<u8>, 16>,
    /// Acknowledge what arrives.
    pub(crate) acknowledging: bool,
    /// The agent's latest acknowledgement that no test step has read yet.
    acked: Option<SeqNum>,
}

impl Client {
    /// A client whose session is not open yet.
    pub(crate) fn new(peer: u32, key: u8) -> Self {
        Self {
            peer,
            key: ClientKey([key; 4]),
            session: SessionId(0x81),
            mtu: MTU,
            next_seq: 0,
            next_loose: 0,
            next_request: 9,
            input: InputReliable::new(StreamId::RELIABLE, vec![0; 16 * 512], 512, vec![0; 1 << 17]),
            acknowledging: true,
            acked: None,
        }
    }

    /// A client with an open session.
    pub(crate) fn open(world: &mut World, peer: u32, key: u8) -> Self {
        let mut client = Self::new(peer, key);
        assert_eq!(client.login(world), [Got::Agent(Status::OK)]);
        client
    }

    pub(crate) fn login(&mut self, world: &mut World) -> Vec<Got> {
        let create = CreateClient {
            version: VERSION,
            vendor: VENDOR,
            key: self.key,
            session: self.session,
            properties: Properties::None,
            mtu: self.mtu,
        };
        let header = Header::new(
            self.session.before_login(),
            StreamId::NONE,
            SeqNum(0),
            self.key,
        );
        self.send(world, &header, &create);
        self.got(world)
    }

    fn send(&self, world: &mut World, header: &Header, body: &impl Encode) {
        let mut buf = [0; 9000];
        let mut message = MessageWriter::new(&mut buf, header).unwrap();
        message.push_padded(body).unwrap();
        world.deliver(self.peer, message.finish());
    }

    /// Sends outside of streams.
    pub(crate) fn control(&mut self, world: &mut World, body: &impl Encode) -> Vec<Got> {
        let header = Header::new(self.session, StreamId::NONE, SeqNum(0), self.key);
        self.send(world, &header, body);
        self.got(world)
    }

    /// Sends on the reliable stream.
    pub(crate) fn request(&mut self, world: &mut World, body: &impl Encode) -> Vec<Got> {
        let header = Header::new(
            self.session,
            StreamId::RELIABLE,
            SeqNum(self.next_seq),
            self.key,
        );
        self.next_seq = self.next_seq.wrapping_add(1);
        self.send(world, &header, body);
        self.got(world)
    }

    pub(crate) fn base(&mut self, object: ObjectId) -> BaseRequest {
        self.next_request = self.next_request.wrapping_add(1).max(10);
        BaseRequest {
            request: RequestId(self.next_request),
            object,
        }
    }

    /// The messages that have arrived since; acknowledged if that is asked for. Acknowledgements of
    /// the agent for messages that this client sent in order are left out.
    pub(crate) fn got(&mut self, world: &mut World) -> Vec<Got> {
        let mut all = Vec::new();
        loop {
            let datagrams = world.take(self.peer);
            if datagrams.is_empty() {
                let next = SeqNum(self.next_seq);
                all.retain(|got| !matches!(got, Got::Ack(seq, 0) if !seq.is_after(next)));
                return all;
            }
            for datagram in datagrams {
                let message = Message::parse(&datagram).unwrap();
                assert_eq!(message.header.session, self.session);
                if message.header.stream.is_reliable() {
                    self.input
                        .receive(message.header.seq, message.body, |submessage| {
                            all.push(decode(submessage.body().unwrap(), submessage.id));
                        });
                } else {
                    for submessage in Submessages::new(message.body) {
                        let submessage = submessage.unwrap();
                        all.push(decode(submessage.body().unwrap(), submessage.id));
                    }
                }
            }
            for got in &all {
                match got {
                    Got::Heartbeat(_, last) => self.input.heartbeat(*last),
                    Got::Ack(first_unacked, _) => self.acked = Some(*first_unacked),
                    _ => {}
                }
            }
            if let Some(ack) = self.input.take_ack().filter(|_| self.acknowledging) {
                let header = Header::new(self.session, StreamId::NONE, SeqNum(0), self.key);
                self.send(world, &header, &ack);
            }
        }
    }

    /// The agent's last acknowledgement, if one has come since the last call.
    pub(crate) fn acknowledged(&mut self, world: &mut World) -> Option<u16> {
        self.got(world);
        self.acked.take().map(|seq| seq.0)
    }

    /// The number of the agent's next reliable message.
    pub(crate) fn expects(&self) -> SeqNum {
        self.input.next_expected()
    }

    /// Acknowledges all that has arrived.
    pub(crate) fn acknowledge(&mut self, world: &mut World) -> Vec<Got> {
        let ack: AckNack = self.input.ack();
        self.control(world, &ack)
    }

    /// Creates an entity and returns the status of the answer.
    pub(crate) fn create(
        &mut self,
        world: &mut World,
        id: ObjectId,
        mode: CreationMode,
        entity: Entity<'_>,
    ) -> Status {
        let base = self.base(id);
        let got = self.request(world, &Create { base, mode, entity });
        let status = got.iter().find_map(|got| match got {
            Got::Status(request, object, status) if *request == base.request => {
                assert_eq!(*object, id);
                Some(*status)
            }
            _ => None,
        });
        status.unwrap_or_else(|| panic!("no answer in {got:?}"))
    }

    pub(crate) fn participant(&mut self, world: &mut World, number: u16, domain: i16) -> Status {
        let id = ObjectId::new(number, ObjectKind::Participant);
        let repr = Representation::Binary(ParticipantBinary::default());
        self.create(
            world,
            id,
            CreationMode::default(),
            Entity::Participant { repr, domain },
        )
    }

    /// A topic with a publisher and a subscriber, all called `number`, of participant `owner`.
    pub(crate) fn topic(
        &mut self,
        world: &mut World,
        number: u16,
        owner: u16,
        name: &str,
        ty: &str,
    ) {
        let participant = ObjectId::new(owner, ObjectKind::Participant);
        let mode = CreationMode::default();
        let topic = TopicBinary {
            name,
            type_reference: None,
            type_name: Some(ty),
        };
        let entity = Entity::Topic {
            repr: Representation::Binary(topic),
            participant,
        };
        let id = ObjectId::new(number, ObjectKind::Topic);
        assert_eq!(self.create(world, id, mode, entity), Status::OK);
        let repr = Representation::Binary(GroupBinary::default());
        let id = ObjectId::new(number, ObjectKind::Publisher);
        let entity = Entity::Publisher { repr, participant };
        assert_eq!(self.create(world, id, mode, entity), Status::OK);
        let id = ObjectId::new(number, ObjectKind::Subscriber);
        let entity = Entity::Subscriber { repr, participant };
        assert_eq!(self.create(world, id, mode, entity), Status::OK);
    }

    /// A writer of the topic with the same number.
    pub(crate) fn writer(&mut self, world: &mut World, number: u16) -> Status {
        let topic = ObjectId::new(number, ObjectKind::Topic);
        let repr = Representation::Binary(DataWriterBinary { topic, qos: None });
        let publisher = ObjectId::new(number, ObjectKind::Publisher);
        let id = ObjectId::new(number, ObjectKind::DataWriter);
        self.create(
            world,
            id,
            CreationMode::default(),
            Entity::DataWriter { repr, publisher },
        )
    }

    /// A writer and a reader of the topic with the same number, with this QoS.
    pub(crate) fn writer_with(
        &mut self,
        world: &mut World,
        number: u16,
        endpoint: EndpointQos<'_>,
    ) -> Status {
        let topic = ObjectId::new(number, ObjectKind::Topic);
        let qos = Some(WriterQos {
            endpoint,
            ownership_strength: None,
        });
        let repr = Representation::Binary(DataWriterBinary { topic, qos });
        let publisher = ObjectId::new(number, ObjectKind::Publisher);
        let entity = Entity::DataWriter { repr, publisher };
        let id = ObjectId::new(number, ObjectKind::DataWriter);
        self.create(world, id, CreationMode::default(), entity)
    }

    pub(crate) fn reader_with(
        &mut self,
        world: &mut World,
        number: u16,
        qos: ReaderQos<'_>,
    ) -> Status {
        let topic = ObjectId::new(number, ObjectKind::Topic);
        let qos = Some(qos);
        let repr = Representation::Binary(DataReaderBinary { topic, qos });
        let subscriber = ObjectId::new(number, ObjectKind::Subscriber);
        let entity = Entity::DataReader { repr, subscriber };
        let id = ObjectId::new(number, ObjectKind::DataReader);
        self.create(world, id, CreationMode::default(), entity)
    }

    /// A requester or replier, number 1, of participant 1.
    pub(crate) fn service(&mut self, world: &mut World, kind: ObjectKind, name: &str) -> Status {
        let repr = Representation::Binary(ServiceBinary {
            service: name,
            request_type: "Q",
            reply_type: "R",
            request_topic: None,
            reply_topic: None,
        });
        let participant = ObjectId::new(1, ObjectKind::Participant);
        let entity = match kind {
            ObjectKind::Requester => Entity::Requester { repr, participant },
            _ => Entity::Replier { repr, participant },
        };
        let id = ObjectId::new(1, kind);
        self.create(world, id, CreationMode::default(), entity)
    }

    /// `READ_DATA` for any entity.
    pub(crate) fn read_from(
        &mut self,
        world: &mut World,
        object: ObjectId,
        control: DeliveryControl,
    ) -> Vec<Got> {
        let read = ReadData {
            base: self.base(object),
            stream: StreamId::RELIABLE,
            filter: None,
            control: Some(control),
        };
        self.request(world, &read)
    }

    /// `WRITE_DATA` to any entity; gives the request's number, too.
    pub(crate) fn write_to(
        &mut self,
        world: &mut World,
        object: ObjectId,
        payload: &[u8],
    ) -> (RequestId, Vec<Got>) {
        let base = self.base(object);
        let got = self.request(world, &WriteData { base, payload });
        (base.request, got)
    }

    /// Sends the last reliable message again: a write of `payload` to writer 1.
    pub(crate) fn again(&mut self, world: &mut World, payload: &[u8]) {
        let base = BaseRequest {
            request: RequestId(self.next_request),
            object: ObjectId::new(1, ObjectKind::DataWriter),
        };
        let seq = SeqNum(self.next_seq.wrapping_sub(1));
        let header = Header::new(self.session, StreamId::RELIABLE, seq, self.key);
        self.send(world, &header, &WriteData { base, payload });
    }

    /// One reliable message with a `WRITE_DATA` to writer `number` for each sample.
    pub(crate) fn write_packed(
        &mut self,
        world: &mut World,
        number: u16,
        samples: &[Vec<u8>],
    ) -> Vec<Got> {
        self.next_seq = self.next_seq.wrapping_add(1);
        self.packed_again(world, number, samples);
        self.got(world)
    }

    /// The same message again.
    pub(crate) fn packed_again(&mut self, world: &mut World, number: u16, samples: &[Vec<u8>]) {
        let base = BaseRequest {
            request: RequestId(self.next_request),
            object: ObjectId::new(number, ObjectKind::DataWriter),
        };
        let seq = SeqNum(self.next_seq.wrapping_sub(1));
        let header = Header::new(self.session, StreamId::RELIABLE, seq, self.key);
        let mut buf = [0; 9000];
        let mut message = MessageWriter::new(&mut buf, &header).unwrap();
        for payload in samples {
            message.push_padded(&WriteData { base, payload }).unwrap();
        }
        world.deliver(self.peer, message.finish());
    }

    /// `WRITE_DATA` to writer `number` on a best-effort stream.
    pub(crate) fn write_loosely(&mut self, world: &mut World, number: u16, payload: &[u8]) {
        let base = self.base(ObjectId::new(number, ObjectKind::DataWriter));
        let seq = SeqNum(self.next_loose);
        self.next_loose = self.next_loose.wrapping_add(1);
        let header = Header::new(self.session, StreamId::BEST_EFFORT, seq, self.key);
        self.send(world, &header, &WriteData { base, payload });
    }

    /// A reader of the topic with the same number, which keeps `depth` samples.
    pub(crate) fn reader(&mut self, world: &mut World, number: u16, depth: u16) -> Status {
        let entity = reader(number, depth);
        let id = ObjectId::new(number, ObjectKind::DataReader);
        self.create(world, id, CreationMode::default(), entity)
    }

    /// `READ_DATA` for reader `number` on `stream`.
    pub(crate) fn read(
        &mut self,
        world: &mut World,
        number: u16,
        stream: StreamId,
        control: Option<DeliveryControl>,
    ) -> Vec<Got> {
        let base = self.base(ObjectId::new(number, ObjectKind::DataReader));
        self.request(
            world,
            &ReadData {
                base,
                stream,
                filter: None,
                control,
            },
        )
    }

    /// `WRITE_DATA` to writer `number`.
    pub(crate) fn write(&mut self, world: &mut World, number: u16, payload: &[u8]) -> Vec<Got> {
        let base = self.base(ObjectId::new(number, ObjectKind::DataWriter));
        self.request(world, &WriteData { base, payload })
    }

    pub(crate) fn delete(&mut self, world: &mut World, id: ObjectId) -> Vec<Got> {
        let base = self.base(id);
        self.request(world, &Delete { base })
    }

    /// Participant 1 in domain 0, topic 1 "t" of type "T", and a writer or reader or both.
    pub(crate) fn endpoint(&mut self, world: &mut World, writer: bool, reader: Option<u16>) {
        assert_eq!(self.participant(world, 1, 0), Status::OK);
        self.topic(world, 1, 1, "t", "T");
        if writer {
            assert_eq!(self.writer(world, 1), Status::OK);
        }
        if let Some(depth) = reader {
            assert_eq!(self.reader(world, 1, depth), Status::OK);
        }
    }
}

pub(crate) fn reader(number: u16, depth: u16) -> Entity<'static> {
    let endpoint = EndpointQos {
        flags: QOS_RELIABLE | QOS_HISTORY_KEEP_LAST,
        depth: Some(depth),
        ..EndpointQos::default()
    };
    let qos = Some(ReaderQos {
        endpoint,
        ..ReaderQos::default()
    });
    let topic = ObjectId::new(number, ObjectKind::Topic);
    Entity::DataReader {
        repr: Representation::Binary(DataReaderBinary { topic, qos }),
        subscriber: ObjectId::new(number, ObjectKind::Subscriber),
    }
}

/// DATA of reader `number`.
pub(crate) fn data(number: u16, payload: &[u8]) -> Got {
    Got::Data(
        ObjectId::new(number, ObjectKind::DataReader),
        payload.to_vec(),
    )
}

/// The payloads of the DATA among these.
pub(crate) fn payloads(got: &[Got]) -> Vec<Vec<u8>> {
    let data = got.iter().filter_map(|got| match got {
        Got::Data(_, payload) => Some(payload.clone()),
        _ => None,
    });
    data.collect()
}

fn decode(body: Body<'_>, id: SubmessageId) -> Got {
    match body {
        Body::StatusAgent(agent) => Got::Agent(agent.status),
        Body::Status(reply) => Got::Status(reply.base.request, reply.base.object, reply.status),
        Body::Data(data) => Got::Data(data.base.object, data.payload.to_vec()),
        Body::AckNack(ack) => Got::Ack(ack.first_unacked, ack.missing),
        Body::Heartbeat(heartbeat) => Got::Heartbeat(heartbeat.first, heartbeat.last),
        _ => Got::Other(id),
    }
}
