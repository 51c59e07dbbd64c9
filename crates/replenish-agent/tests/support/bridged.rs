//! XRCE clients over UDP to an agent with a bridge to DDS, and programs in DDS.
#![allow(dead_code, reason = "every test binary uses its own part")]

#[path = "program.rs"]
mod program;

pub(crate) use program::{Program, domain};

use replenish_agent::dds::{DdsLimits, Topic};
use replenish_agent::{Agent, AgentConfig, DdsBridge, RunningAgent};
use replenish_xrce::client::{
    Buffers, Config, Event, PingPolicy, ReliableBuffers, RequestState, Session, SessionState,
};
use replenish_xrce::wire::{
    ClientKey, CreationMode, DataReaderBinary, DataWriterBinary, DeliveryControl, EndpointQos,
    Entity, GroupBinary, Notice, ObjectId, ObjectKind, ParticipantBinary, QOS_HISTORY_KEEP_LAST,
    QOS_RELIABLE, ReaderQos, Representation, RequestId, SampleIdentity, ServiceBinary, Status,
    StreamId, TopicBinary, WriterQos,
};
use std::net::{Ipv4Addr, UdpSocket};
use std::time::{Duration, Instant};

/// The type of all topics here.
pub(crate) const INT32: &str = "std_msgs::msg::dds_::Int32_";

const MS: u64 = 1_000_000;
const TIMEOUT: Duration = Duration::from_secs(60);

/// An agent on loopback whose clients are in `domain`.
pub(crate) fn agent(domain: u16) -> RunningAgent {
    agent_with(domain, |_| {})
}

/// An agent with other settings.
pub(crate) fn agent_with(domain: u16, change: impl FnOnce(&mut DdsLimits)) -> RunningAgent {
    let mut bridge = DdsBridge {
        domain,
        ..DdsBridge::default()
    };
    change(&mut bridge.dds.limits);
    let config = AgentConfig {
        addr: (Ipv4Addr::LOCALHOST, 0).into(),
        dds: Some(bridge),
        ..AgentConfig::default()
    };
    Agent::bind(&config).unwrap().spawn().unwrap()
}

/// The topics of the service that the tests call.
pub(crate) fn service_topics() -> (Topic, Topic) {
    let name = "example_interfaces::srv::dds_::AddTwoInts";
    (
        Topic::new("rq/addRequest", format!("{name}_Request_")),
        Topic::new("rr/addReply", format!("{name}_Response_")),
    )
}

const fn id(number: u16, kind: ObjectKind) -> ObjectId {
    ObjectId::new(number, kind)
}

/// A client on a socket.
pub(crate) struct Client {
    socket: UdpSocket,
    session: Session<Vec<u8>, 32, 32>,
    start: Instant,
    /// Samples and requests, the latter after their identity.
    pub(crate) got: Vec<Vec<u8>>,
    replies: Vec<(RequestId, Vec<u8>)>,
    /// A requester: its service has a server, as the agent says.
    pub(crate) served: bool,
    /// Its endpoints that clash with others, and the policies.
    pub(crate) clashes: Vec<(ObjectId, u8)>,
    kind: ObjectKind,
    /// Its requests that were refused, where a test expects it.
    pub(crate) refused: Option<Vec<(ObjectId, Status)>>,
}

/// A client with a writer and a reader.
pub(crate) fn topic_client(
    agent: &RunningAgent,
    key: u8,
    writes: &str,
    reads: &str,
    stream: StreamId,
) -> Client {
    typed_client(agent, key, INT32, (writes, reads), stream)
}

/// A client with a writer and a reader of a type.
pub(crate) fn typed_client(
    agent: &RunningAgent,
    key: u8,
    type_name: &str,
    (writes, reads): (&str, &str),
    stream: StreamId,
) -> Client {
    let mut client = Client::new(agent, key, ObjectKind::DataWriter);
    let participant = id(1, ObjectKind::Participant);
    for (number, name) in [(1, writes), (2, reads)] {
        let topic = TopicBinary {
            name,
            type_reference: None,
            type_name: Some(type_name),
        };
        let repr = Representation::Binary(topic);
        client.create(
            id(number, ObjectKind::Topic),
            Entity::Topic { repr, participant },
        );
    }
    let repr = Representation::Binary(GroupBinary::default());
    let (publisher, subscriber) = (id(1, ObjectKind::Publisher), id(1, ObjectKind::Subscriber));
    client.create(publisher, Entity::Publisher { repr, participant });
    client.create(subscriber, Entity::Subscriber { repr, participant });
    let reliable = if stream.is_reliable() {
        QOS_RELIABLE
    } else {
        0
    };
    let endpoint = EndpointQos {
        flags: reliable | QOS_HISTORY_KEEP_LAST,
        depth: Some(100),
        ..EndpointQos::default()
    };
    let writer = DataWriterBinary {
        topic: id(1, ObjectKind::Topic),
        qos: Some(WriterQos {
            endpoint,
            ownership_strength: None,
        }),
    };
    let repr = Representation::Binary(writer);
    client.create(
        id(1, ObjectKind::DataWriter),
        Entity::DataWriter { repr, publisher },
    );
    let reader = DataReaderBinary {
        topic: id(2, ObjectKind::Topic),
        qos: Some(ReaderQos {
            endpoint,
            time_filter_ms: None,
            content_filter: None,
        }),
    };
    let repr = Representation::Binary(reader);
    let reader = id(2, ObjectKind::DataReader);
    client.create(reader, Entity::DataReader { repr, subscriber });
    client.connect(reader, stream);
    client
}

/// A client with a writer on each of these topics; some may be refused.
pub(crate) fn writers(agent: &RunningAgent, key: u8, topics: &[(String, &str)]) -> Client {
    let mut client = Client::new(agent, key, ObjectKind::DataWriter);
    client.refused = Some(Vec::new());
    let participant = id(1, ObjectKind::Participant);
    let repr = Representation::Binary(GroupBinary::default());
    let publisher = id(1, ObjectKind::Publisher);
    client.create(publisher, Entity::Publisher { repr, participant });
    for (number, (name, type_name)) in (1..).zip(topics) {
        let topic = id(number, ObjectKind::Topic);
        let repr = Representation::Binary(TopicBinary {
            name,
            type_reference: None,
            type_name: Some(type_name),
        });
        client.create(topic, Entity::Topic { repr, participant });
        let repr = Representation::Binary(DataWriterBinary { topic, qos: None });
        let writer = id(number, ObjectKind::DataWriter);
        client.create(writer, Entity::DataWriter { repr, publisher });
    }
    let now = client.now();
    client.session.connect(now);
    client.until(|client| client.session.state() == SessionState::Up);
    for (number, _) in (1..).zip(topics) {
        let writer = id(number, ObjectKind::DataWriter);
        let is_open = |state| matches!(state, Some(RequestState::Queued | RequestState::Asked));
        client.until(|client| !is_open(client.session.creation(writer)));
    }
    client
}

/// A client with a requester or replier of the tests' service.
pub(crate) fn service_client(agent: &RunningAgent, key: u8, kind: ObjectKind) -> Client {
    let mut client = Client::new(agent, key, kind);
    let participant = id(1, ObjectKind::Participant);
    let (request, reply) = service_topics();
    let repr = Representation::Binary(ServiceBinary {
        service: "/add",
        request_type: &request.type_name,
        reply_type: &reply.type_name,
        request_topic: Some(&request.name),
        reply_topic: Some(&reply.name),
    });
    let entity = match kind {
        ObjectKind::Requester => Entity::Requester { repr, participant },
        _ => Entity::Replier { repr, participant },
    };
    client.create(id(1, kind), entity);
    client.connect(id(1, kind), StreamId::RELIABLE);
    client
}

impl Client {
    fn new(agent: &RunningAgent, key: u8, kind: ObjectKind) -> Self {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        socket.connect(agent.local_addr()).unwrap();
        let mut config = Config::new(ClientKey([key; 4]));
        config.confirm_delivery = true;
        config.ping = Some(PingPolicy {
            after: 500 * MS,
            silence_limit: 20_000 * MS,
        });
        let buffer = |len| vec![0; len];
        let buffers = Buffers {
            best_effort: [buffer(512)],
            reliable: [ReliableBuffers {
                output: buffer(32 * 512),
                large_output: buffer(0),
                input: buffer(16 * 512),
                fragments: buffer(32 * 512),
            }],
            restore: buffer(512),
            journal: buffer(4096),
        };
        let mut client = Self {
            socket,
            session: Session::new(config, buffers),
            start: Instant::now(),
            got: Vec::new(),
            replies: Vec::new(),
            served: false,
            clashes: Vec::new(),
            kind,
            refused: None,
        };
        let name = format!("mcu/node_{key}");
        let binary = ParticipantBinary {
            name: Some(&name),
            ..ParticipantBinary::default()
        };
        let repr = Representation::Binary(binary);
        let participant = id(1, ObjectKind::Participant);
        client.create(participant, Entity::Participant { repr, domain: 0 });
        client
    }

    fn create(&mut self, object: ObjectId, entity: Entity<'_>) {
        let mode = CreationMode::REUSE_OR_REPLACE;
        self.session.create(object, mode, &entity).unwrap();
    }

    fn connect(&mut self, reads: ObjectId, stream: StreamId) {
        let all = DeliveryControl::UNLIMITED;
        self.session.read(reads, stream, all).unwrap();
        self.session.connect(self.now());
        self.until(|client| client.session.state() == SessionState::Up);
    }

    fn now(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap()
    }

    /// One wait of up to 20 ms.
    fn turn(&mut self) {
        let now = self.now();
        while let Some(bytes) = self.session.poll_transmit(now) {
            self.socket.send(bytes).unwrap();
        }
        let wait = self.session.next_deadline();
        let wait = wait.map_or(20 * MS, |at| at.saturating_sub(now).clamp(MS / 10, 20 * MS));
        let wait = Duration::from_nanos(wait);
        self.socket.set_read_timeout(Some(wait)).unwrap();
        let mut buf = [0; 4096];
        let received = self.socket.recv(&mut buf);
        let now = self.now();
        let (got, replies) = (&mut self.got, &mut self.replies);
        let (is_served, clashes) = (&mut self.served, &mut self.clashes);
        let refused = &mut self.refused;
        let mut keep = |event: Event<'_>| match event {
            Event::Data { payload, .. } => got.push(payload.to_vec()),
            Event::Request {
                identity, payload, ..
            } => got.push([&identity.0[..], payload].concat()),
            Event::Reply {
                request, payload, ..
            } => replies.push((request, payload.to_vec())),
            Event::Notice {
                notice: Notice::Served(served),
                ..
            } => *is_served = served,
            Event::Notice {
                object,
                notice: Notice::IncompatibleQos(policies),
            } => clashes.push((object, policies)),
            Event::Status { object, status, .. } if !status.is_ok() => match refused {
                Some(refused) => refused.push((object, status)),
                None => panic!("{status}"),
            },
            _ => {}
        };
        if let Ok(len) = received {
            self.session.handle(now, &buf[..len], &mut keep);
        }
        self.session.tick(now, &mut keep);
        let now = self.now();
        while let Some(bytes) = self.session.poll_transmit(now) {
            self.socket.send(bytes).unwrap();
        }
    }

    pub(crate) fn until(&mut self, done: impl Fn(&Self) -> bool) {
        let deadline = Instant::now() + TIMEOUT;
        while !done(self) {
            let state = self.session.state();
            assert!(Instant::now() < deadline, "in vain: {state:?}");
            self.turn();
        }
    }

    /// Listens for some time.
    pub(crate) fn idle(&mut self, time: Duration) {
        let end = Instant::now() + time;
        while Instant::now() < end {
            self.turn();
        }
    }

    /// Writes a sample; as a replier a reply, after its 24 bytes of identity.
    pub(crate) fn write(&mut self, stream: StreamId, payload: &[u8]) {
        let session = &mut self.session;
        let object = id(1, self.kind);
        if self.kind == ObjectKind::Replier {
            let (identity, reply) = SampleIdentity::split(payload).unwrap();
            session.reply(object, stream, identity, reply).unwrap();
        } else {
            session.write(object, stream, payload).unwrap();
        }
        self.flush();
    }

    /// Sends a request.
    pub(crate) fn request(&mut self, payload: &[u8]) -> RequestId {
        let object = id(1, ObjectKind::Requester);
        let request = self
            .session
            .request(object, StreamId::RELIABLE, payload)
            .unwrap();
        self.flush();
        request
    }

    fn flush(&mut self) {
        let now = self.now();
        while let Some(bytes) = self.session.poll_transmit(now) {
            self.socket.send(bytes).unwrap();
        }
    }

    /// The next sample or request.
    pub(crate) fn read(&mut self) -> Vec<u8> {
        self.until(|client| !client.got.is_empty());
        self.got.remove(0)
    }

    /// The next reply.
    pub(crate) fn reply(&mut self) -> (RequestId, Vec<u8>) {
        self.until(|client| !client.replies.is_empty());
        self.replies.remove(0)
    }

    pub(crate) fn close(mut self) {
        let now = self.now();
        self.session.close(now);
        self.until(|client| client.session.state() == SessionState::Idle);
    }
}

/// A program in DDS.
pub(crate) fn dds_program(domain: u16) -> Program {
    Program::new(domain)
}
