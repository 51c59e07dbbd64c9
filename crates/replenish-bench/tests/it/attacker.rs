//! A client that says what it likes, without waiting for any answer.

use replenish_xrce::SeqNum;
use replenish_xrce::framing::prefix;
use replenish_xrce::wire::{
    BaseRequest, Body, ClientKey, Create, CreateClient, CreationMode, DataReaderBinary,
    DataWriterBinary, Delete, DeliveryControl, EndpointQos, Entity, GetInfo, GroupBinary, Header,
    Message, MessageWriter, ObjectId, ObjectKind, ParticipantBinary, Properties, ReadData,
    ReaderQos, Representation, RequestId, ServiceBinary, SessionId, Status, StreamId, TopicBinary,
    VENDOR, VERSION, WriteData, WriterQos,
};
use rustls::{ClientConfig, ClientConnection};
use std::cell::Cell;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream, UdpSocket};
use std::sync::Arc;
use std::time::{Duration, Instant};

pub(crate) const SESSION: SessionId = SessionId(0x81);

/// Time that an agent may take nothing from a connection, unless a test sets another one.
const STUCK: Duration = Duration::from_secs(2);

thread_local! {
    /// Bytes that attackers of this thread have sent.
    pub(crate) static SENT: Cell<u64> = const { Cell::new(0) };
}

fn count(bytes: usize) {
    SENT.set(SENT.get() + bytes as u64);
}

/// A message in the session of `key` on `stream`.
pub(crate) fn message(
    (key, session): (u32, SessionId),
    (stream, seq): (StreamId, u16),
    fill: impl FnOnce(&mut MessageWriter<'_>),
) -> Vec<u8> {
    let mut buf = vec![0; 65_535];
    let header = Header::new(session, stream, SeqNum(seq), ClientKey(key.to_be_bytes()));
    let mut message = MessageWriter::new(&mut buf, &header).unwrap();
    fill(&mut message);
    message.finish().to_vec()
}

/// A log-in.
pub(crate) fn log_in(key: u32, mtu: u16) -> Vec<u8> {
    let create = CreateClient {
        version: VERSION,
        vendor: VENDOR,
        key: ClientKey(key.to_be_bytes()),
        session: SESSION,
        properties: Properties::None,
        mtu,
    };
    let stream = (StreamId::NONE, 0);
    message((key, SESSION.before_login()), stream, |message| {
        message.push_padded(&create).unwrap();
    })
}

/// As many questions as fit into `room` bytes, in the session or outside.
pub(crate) fn questions(key: u32, session: SessionId, room: usize) -> Vec<u8> {
    let mut all = message((key, session), (StreamId::NONE, 0), |message| {
        let get = GetInfo {
            base: base(ObjectId::AGENT),
            mask: 0,
        };
        while message.len() + 16 <= room && message.push_padded(&get).is_ok() {}
    });
    all.truncate(room);
    all
}

pub(crate) fn base(object: ObjectId) -> BaseRequest {
    BaseRequest {
        request: RequestId(10),
        object,
    }
}

/// The answer to a log-in, if `bytes` are one.
pub(crate) fn answer(bytes: &[u8]) -> Option<Status> {
    let message = Message::parse(bytes).ok()?;
    let bodies = message
        .submessages()
        .filter_map(|s| s.ok()?.body().ok().map(status));
    bodies.flatten().next()
}

fn status(body: Body<'_>) -> Option<Status> {
    match body {
        Body::StatusAgent(agent) => Some(agent.status),
        _ => None,
    }
}

/// A UDP socket on loopback that is sure to be another host's.
pub(crate) fn host(number: u32) -> UdpSocket {
    let ip = Ipv4Addr::from_bits((127 << 24) + (1 << 16) + number);
    UdpSocket::bind((ip, 0)).unwrap()
}

/// Sends a datagram, and gives the agent the CPU now and then.
pub(crate) fn send(socket: &UdpSocket, agent: SocketAddr, bytes: &[u8]) {
    count(bytes.len());
    socket.send_to(bytes, agent).ok();
    if SENT.get().is_multiple_of(7) {
        std::thread::sleep(Duration::from_micros(100));
    }
}

/// A client on a TCP connection.
pub(crate) struct Raw {
    pub(crate) stream: TcpStream,
    /// The connection is encrypted.
    tls: Option<Box<ClientConnection>>,
    pub(crate) key: u32,
    /// Read what the agent sends, and forget it.
    pub(crate) reads: bool,
    /// Time that the agent may take nothing.
    pub(crate) patience: Duration,
    loose: u16,
}

impl Raw {
    /// A connection without a log-in.
    pub(crate) fn connect(agent: SocketAddr, key: u32) -> Self {
        let stream = TcpStream::connect(agent).unwrap();
        stream.set_nonblocking(true).unwrap();
        Self {
            stream,
            tls: None,
            key,
            reads: true,
            patience: STUCK,
            loose: 0,
        }
    }

    /// A client with a session and a participant, which takes messages of `mtu` bytes.
    pub(crate) fn open(agent: SocketAddr, key: u32, mtu: u16) -> Self {
        let mut raw = Self::connect(agent, key);
        raw.log_in(mtu);
        raw
    }

    /// The same over TLS.
    pub(crate) fn open_tls(agent: SocketAddr, key: u32, mtu: u16, config: ClientConfig) -> Self {
        let mut raw = Self::connect(agent, key);
        let name = "agent".try_into().unwrap();
        let mut tls = ClientConnection::new(Arc::new(config), name).unwrap();
        raw.stream.set_nonblocking(false).unwrap();
        while tls.is_handshaking() {
            tls.complete_io(&mut raw.stream).unwrap();
        }
        raw.stream.set_nonblocking(true).unwrap();
        raw.tls = Some(Box::new(tls));
        raw.log_in(mtu);
        raw
    }

    fn log_in(&mut self, mtu: u16) {
        self.frame(&log_in(self.key, mtu));
        self.control(|message| {
            let repr = Representation::Binary(ParticipantBinary::default());
            let entity = Entity::Participant { repr, domain: 0 };
            push(message, ObjectId::new(1, ObjectKind::Participant), entity);
        });
    }

    /// Reads all that waits, and forgets it.
    fn forget(&mut self) {
        let mut buf = [0; 65_536];
        let Some(tls) = &mut self.tls else {
            while self.stream.read(&mut buf).is_ok_and(|len| len > 0) {}
            return;
        };
        while tls.read_tls(&mut self.stream).is_ok_and(|len| len > 0) {
            tls.process_new_packets().unwrap();
            while tls.reader().read(&mut buf).is_ok_and(|len| len > 0) {}
        }
    }

    fn write_some(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(tls) = &mut self.tls else {
            return self.stream.write(bytes);
        };
        while tls.wants_write() {
            tls.write_tls(&mut self.stream)?;
        }
        let len = tls.writer().write(bytes)?;
        while tls.wants_write() && tls.write_tls(&mut self.stream).is_ok() {}
        Ok(len)
    }

    /// Sends bytes; false once the agent takes nothing for a while, or has closed.
    pub(crate) fn bytes(&mut self, mut bytes: &[u8]) -> bool {
        let mut last = Instant::now();
        while !bytes.is_empty() {
            if self.reads {
                self.forget();
            }
            match self.write_some(bytes) {
                Ok(len) => {
                    count(len);
                    bytes = &bytes[len..];
                    last = Instant::now();
                }
                Err(e) if e.kind() == ErrorKind::WouldBlock && last.elapsed() < self.patience => {
                    std::thread::sleep(Duration::from_micros(200));
                }
                Err(_) => return false,
            }
        }
        true
    }

    pub(crate) fn frame(&mut self, message: &[u8]) -> bool {
        let prefix = prefix(message.len()).unwrap();
        self.bytes(&[&prefix[..], message].concat())
    }

    /// A message outside of streams.
    pub(crate) fn control(&mut self, fill: impl FnOnce(&mut MessageWriter<'_>)) -> bool {
        let message = message((self.key, SESSION), (StreamId::NONE, 0), fill);
        self.frame(&message)
    }

    /// A message on the best-effort stream.
    pub(crate) fn loose(&mut self, fill: impl FnOnce(&mut MessageWriter<'_>)) -> bool {
        let seq = self.loose;
        self.loose = seq.wrapping_add(1);
        let message = message((self.key, SESSION), (StreamId::BEST_EFFORT, seq), fill);
        self.frame(&message)
    }

    /// A topic of type "T" with its publisher and subscriber, all called `number`.
    pub(crate) fn topic(&mut self, number: u16, name: &str) {
        self.typed_topic(number, name, "T");
    }

    /// The same with a type.
    pub(crate) fn typed_topic(&mut self, number: u16, name: &str, type_name: &str) {
        self.control(|message| {
            let participant = ObjectId::new(1, ObjectKind::Participant);
            let repr = Representation::Binary(TopicBinary {
                name,
                type_reference: None,
                type_name: Some(type_name),
            });
            let id = |kind| ObjectId::new(number, kind);
            push(
                message,
                id(ObjectKind::Topic),
                Entity::Topic { repr, participant },
            );
            let group = || Representation::Binary(GroupBinary::default());
            let entity = Entity::Publisher {
                repr: group(),
                participant,
            };
            push(message, id(ObjectKind::Publisher), entity);
            let entity = Entity::Subscriber {
                repr: group(),
                participant,
            };
            push(message, id(ObjectKind::Subscriber), entity);
        });
    }

    /// A writer of topic `topic`.
    pub(crate) fn writer(&mut self, number: u16, topic: u16, qos: EndpointQos<'_>) {
        let qos = Some(WriterQos {
            endpoint: qos,
            ownership_strength: None,
        });
        let topic_id = ObjectId::new(topic, ObjectKind::Topic);
        let repr = Representation::Binary(DataWriterBinary {
            topic: topic_id,
            qos,
        });
        let publisher = ObjectId::new(topic, ObjectKind::Publisher);
        let entity = Entity::DataWriter { repr, publisher };
        let id = ObjectId::new(number, ObjectKind::DataWriter);
        self.control(|message| push(message, id, entity));
    }

    /// A reader of topic `topic`.
    pub(crate) fn reader(&mut self, number: u16, topic: u16, qos: EndpointQos<'_>) {
        let qos = Some(ReaderQos {
            endpoint: qos,
            ..ReaderQos::default()
        });
        let topic_id = ObjectId::new(topic, ObjectKind::Topic);
        let repr = Representation::Binary(DataReaderBinary {
            topic: topic_id,
            qos,
        });
        let subscriber = ObjectId::new(topic, ObjectKind::Subscriber);
        let entity = Entity::DataReader { repr, subscriber };
        let id = ObjectId::new(number, ObjectKind::DataReader);
        self.control(|message| push(message, id, entity));
    }

    /// A requester whose four names are as long as they may be.
    pub(crate) fn requester(&mut self, number: u16) {
        let name = |what: &str| format!("{what}{:08x}{number:04x}{}", self.key, "\"".repeat(255));
        let [q, r, t, u] = ["rq/", "rr/", "t", "u"].map(name);
        let repr = Representation::Binary(ServiceBinary {
            service: "s",
            request_type: &t[..255],
            reply_type: &u[..255],
            request_topic: Some(&q[..255]),
            reply_topic: Some(&r[..255]),
        });
        let participant = ObjectId::new(1, ObjectKind::Participant);
        let entity = Entity::Requester { repr, participant };
        let id = ObjectId::new(number, ObjectKind::Requester);
        self.control(|message| push(message, id, entity));
    }

    pub(crate) fn delete(&mut self, number: u16, kind: ObjectKind) {
        let base = base(ObjectId::new(number, kind));
        self.control(|message| message.push_padded(&Delete { base }).unwrap());
    }

    /// Asks for all samples of a reader on `stream`.
    pub(crate) fn read(&mut self, number: u16, stream: StreamId) {
        let read = ReadData {
            base: base(ObjectId::new(number, ObjectKind::DataReader)),
            stream,
            filter: None,
            control: Some(DeliveryControl::UNLIMITED),
        };
        self.control(|message| message.push_padded(&read).unwrap());
    }

    /// Writes a sample of `len` bytes on the best-effort stream.
    pub(crate) fn write(&mut self, number: u16, len: usize) -> bool {
        let payload = vec![number as u8; len];
        let write = WriteData {
            base: base(ObjectId::new(number, ObjectKind::DataWriter)),
            payload: &payload,
        };
        self.loose(|message| message.push_padded(&write).unwrap())
    }

    /// Writes as many samples of `len` bytes as a message of 60 kB takes.
    pub(crate) fn write_many(&mut self, number: u16, len: usize) -> bool {
        let payload = vec![number as u8; len];
        let write = WriteData {
            base: base(ObjectId::new(number, ObjectKind::DataWriter)),
            payload: &payload,
        };
        self.loose(
            |message| {
                while message.len() + len < 60_000 && message.push_padded(&write).is_ok() {}
            },
        )
    }
}

/// All that is needed to read topic `name`, as messages outside of streams.
pub(crate) fn subscription(key: u32, name: &str) -> Vec<Vec<u8>> {
    let id = |kind| ObjectId::new(1, kind);
    let participant = id(ObjectKind::Participant);
    let node = Representation::Binary(ParticipantBinary::default());
    let repr = Representation::Binary(TopicBinary {
        name,
        type_reference: None,
        type_name: Some("T"),
    });
    let group = Representation::Binary(GroupBinary::default());
    let reader = Representation::Binary(DataReaderBinary {
        topic: id(ObjectKind::Topic),
        qos: None,
    });
    let subscriber = id(ObjectKind::Subscriber);
    let entities = [
        (
            participant,
            Entity::Participant {
                repr: node,
                domain: 0,
            },
        ),
        (id(ObjectKind::Topic), Entity::Topic { repr, participant }),
        (
            subscriber,
            Entity::Subscriber {
                repr: group,
                participant,
            },
        ),
        (
            id(ObjectKind::DataReader),
            Entity::DataReader {
                repr: reader,
                subscriber,
            },
        ),
    ];
    let outside = (StreamId::NONE, 0);
    let creates = entities.into_iter().map(|(object, entity)| {
        message((key, SESSION), outside, |message| {
            push(message, object, entity);
        })
    });
    let read = ReadData {
        base: base(id(ObjectKind::DataReader)),
        stream: StreamId::BEST_EFFORT,
        filter: None,
        control: Some(DeliveryControl::UNLIMITED),
    };
    let read = message((key, SESSION), outside, |m| m.push_padded(&read).unwrap());
    creates.chain([read]).collect()
}

fn push(message: &mut MessageWriter<'_>, object: ObjectId, entity: Entity<'_>) {
    let create = Create {
        base: base(object),
        mode: CreationMode::REUSE_OR_REPLACE,
        entity,
    };
    message.push_padded(&create).unwrap();
}
