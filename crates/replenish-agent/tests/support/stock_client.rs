//! A client with the habits of eProsima's, as they were recorded (`docs/peers.md`): messages of 512
//! bytes, no properties in the log-in, Nagle's algorithm on TCP with bursts of 40 samples, four
//! reliable messages under way at most, and an ACKNACK for every reliable message.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]
#![allow(dead_code, reason = "every test binary uses its own part")]

use replenish_xrce::SeqNum;
use replenish_xrce::framing::{Prefixed, prefix};
use replenish_xrce::stream::InputReliable;
use replenish_xrce::wire::{
    BaseRequest, Body, ClientKey, Create, CreateClient, CreationMode, DataReaderBinary,
    DataWriterBinary, DeliveryControl, Encode, EndpointQos, Entity, GroupBinary, Header, Message,
    MessageWriter, ObjectId, ObjectKind, ParticipantBinary, Properties, QOS_HISTORY_KEEP_LAST,
    QOS_RELIABLE, ReadData, ReaderQos, Representation, RequestId, SessionId, StreamId, TopicBinary,
    VENDOR, VERSION, WriteData, WriterQos,
};
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::time::{Duration, Instant};

const SESSION: SessionId = SessionId(0x81);

/// When what is not acknowledged is sent again over UDP.
const AGAIN: Duration = Duration::from_millis(100);

/// Samples of a burst, at a kilohertz.
const BURST: usize = 40;

/// Samples under way at most: a socket of the kernel holds more, and a machine that stood still
/// does not send all that was due at once.
const UNDER_WAY: usize = 5 * BURST;

/// Reliable messages that a stock client keeps.
pub(crate) const HISTORY: usize = 4;

/// A topic's name and type.
pub(crate) type Topic<'a> = (&'a str, &'a str);

/// Reliable, and everything is kept.
pub(crate) const KEEP_ALL: EndpointQos<'static> = EndpointQos {
    flags: QOS_RELIABLE,
    depth: None,
    deadline_ms: None,
    lifespan_ms: None,
    user_data: None,
};

/// Reliable, and the last 10 are kept.
pub(crate) const KEEP_TEN: EndpointQos<'static> = EndpointQos {
    flags: QOS_RELIABLE | QOS_HISTORY_KEEP_LAST,
    depth: Some(10),
    ..KEEP_ALL
};

/// Address of an agent.
#[derive(Clone, Copy)]
pub(crate) enum At {
    Udp(SocketAddr),
    Tcp(SocketAddr),
}

enum Io {
    Udp(UdpSocket),
    Tcp(TcpStream, Prefixed<Vec<u8>>),
}

/// A client with one topic.
pub(crate) struct Stock {
    io: Io,
    key: ClientKey,
    next: [u16; 2],
    /// The messages that the agent has not acknowledged, and when they were last sent.
    kept: VecDeque<(u16, Vec<u8>)>,
    sent: Instant,
    input: InputReliable<Vec<u8>, Vec<u8>, 16>,
    /// Samples that have arrived.
    pub(crate) got: Vec<Vec<u8>>,
    /// The agent has answered the log-in.
    is_in: bool,
}

fn base(kind: ObjectKind) -> BaseRequest {
    BaseRequest {
        request: RequestId(10),
        object: ObjectId::new(1, kind),
    }
}

impl Stock {
    pub(crate) fn new(at: At, key: u8) -> Self {
        let io = match at {
            At::Tcp(agent) => {
                let stream = TcpStream::connect(agent).unwrap();
                stream.set_nonblocking(true).unwrap();
                Io::Tcp(stream, Prefixed::new(vec![0; 65_535]))
            }
            At::Udp(agent) => {
                let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
                socket.connect(agent).unwrap();
                socket.set_nonblocking(true).unwrap();
                Io::Udp(socket)
            }
        };
        let input =
            InputReliable::new(StreamId::RELIABLE, vec![0; 16 * 512], 512, vec![0; 1 << 10]);
        let mut client = Self {
            io,
            key: ClientKey([key; 4]),
            next: [0; 2],
            kept: VecDeque::new(),
            sent: Instant::now(),
            input,
            got: Vec::new(),
            is_in: false,
        };
        let login = CreateClient {
            version: VERSION,
            vendor: VENDOR,
            key: client.key,
            session: SESSION,
            properties: Properties::None,
            mtu: 512,
        };
        let login = client.message(SESSION.before_login(), (StreamId::NONE, 0), &login);
        client.send(&login);
        let end = Instant::now() + Duration::from_secs(60);
        while !client.is_in {
            assert!(Instant::now() < end, "no answer to the log-in");
            client.turn();
        }
        client
    }

    /// Participant, topic, publisher, subscriber, writer and perhaps a reader, as a stock client
    /// creates them: each is acknowledged before the next one. A reader that asks for nothing would
    /// only lose samples.
    pub(crate) fn equip(
        &mut self,
        topic: Topic<'_>,
        writer: EndpointQos<'_>,
        reader: Option<EndpointQos<'_>>,
    ) {
        let id = |kind| ObjectId::new(1, kind);
        let participant = id(ObjectKind::Participant);
        let group = || Representation::Binary(GroupBinary::default());
        let repr = Representation::Binary(TopicBinary {
            name: topic.0,
            type_reference: None,
            type_name: Some(topic.1),
        });
        self.create(
            ObjectKind::Participant,
            Entity::Participant {
                repr: Representation::Binary(ParticipantBinary::default()),
                domain: 0,
            },
        );
        self.create(ObjectKind::Topic, Entity::Topic { repr, participant });
        let repr = group();
        let publisher = Entity::Publisher { repr, participant };
        self.create(ObjectKind::Publisher, publisher);
        let repr = group();
        let subscriber = Entity::Subscriber { repr, participant };
        self.create(ObjectKind::Subscriber, subscriber);
        let qos = Some(WriterQos {
            endpoint: writer,
            ownership_strength: None,
        });
        let topic = id(ObjectKind::Topic);
        let repr = Representation::Binary(DataWriterBinary { topic, qos });
        let publisher = id(ObjectKind::Publisher);
        self.create(
            ObjectKind::DataWriter,
            Entity::DataWriter { repr, publisher },
        );
        if let Some(endpoint) = reader {
            let qos = Some(ReaderQos {
                endpoint,
                ..ReaderQos::default()
            });
            let repr = Representation::Binary(DataReaderBinary { topic, qos });
            let subscriber = id(ObjectKind::Subscriber);
            self.create(
                ObjectKind::DataReader,
                Entity::DataReader { repr, subscriber },
            );
        }
    }

    fn create(&mut self, kind: ObjectKind, entity: Entity<'_>) {
        self.reliable(&Create {
            base: base(kind),
            mode: CreationMode::REUSE_OR_REPLACE,
            entity,
        });
        self.until_acknowledged();
    }

    /// Asks for all samples on `stream`.
    pub(crate) fn read(&mut self, stream: StreamId) {
        self.reliable(&ReadData {
            base: base(ObjectKind::DataReader),
            stream,
            filter: None,
            control: Some(DeliveryControl::UNLIMITED),
        });
        self.until_acknowledged();
    }

    fn until_acknowledged(&mut self) {
        let end = Instant::now() + Duration::from_secs(60);
        while self.under_way() > 0 {
            assert!(Instant::now() < end, "a request is not acknowledged");
            self.turn();
        }
    }

    /// Reliable messages that the agent has not acknowledged.
    pub(crate) fn under_way(&self) -> usize {
        self.kept.len()
    }

    fn reliable(&mut self, body: &impl Encode) {
        let seq = self.next[1];
        self.next[1] = seq.wrapping_add(1);
        let message = self.message(SESSION, (StreamId::RELIABLE, seq), body);
        self.send(&message);
        self.kept.push_back((seq, message));
        self.sent = Instant::now();
    }

    /// Writes a sample.
    pub(crate) fn write(&mut self, stream: StreamId, payload: &[u8]) {
        let base = base(ObjectKind::DataWriter);
        let body = WriteData { base, payload };
        if stream.is_reliable() {
            return self.reliable(&body);
        }
        let seq = self.next[0];
        self.next[0] = seq.wrapping_add(1);
        let message = self.message(SESSION, (stream, seq), &body);
        self.send(&message);
    }

    fn message(
        &self,
        session: SessionId,
        (on, seq): (StreamId, u16),
        body: &impl Encode,
    ) -> Vec<u8> {
        let header = Header::new(session, on, SeqNum(seq), self.key);
        let mut buf = vec![0; 32_768];
        let mut message = MessageWriter::new(&mut buf, &header).unwrap();
        message.push_padded(body).unwrap();
        message.finish().to_vec()
    }

    fn send(&mut self, message: &[u8]) {
        match &mut self.io {
            Io::Udp(socket) => drop(socket.send(message).unwrap()),
            Io::Tcp(stream, _) => {
                let bytes = [&prefix(message.len()).unwrap(), message].concat();
                assert_eq!(stream.write(&bytes).unwrap(), bytes.len());
            }
        }
    }

    /// Takes what has come, acknowledges it, and sends again what is not acknowledged for long.
    pub(crate) fn turn(&mut self) {
        let mut messages = Vec::new();
        let mut buf = [0; 4096];
        loop {
            let read = match &mut self.io {
                Io::Udp(socket) => socket.recv(&mut buf),
                Io::Tcp(stream, _) => stream.read(&mut buf),
            };
            match read {
                Ok(len) => match &mut self.io {
                    Io::Udp(_) => messages.push(buf[..len].to_vec()),
                    Io::Tcp(_, decoder) => {
                        assert!(len > 0, "the agent has closed the connection");
                        decoder.push(&buf[..len], |message| messages.push(message.to_vec()));
                    }
                },
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) => panic!("{error}"),
            }
        }
        if messages.is_empty() {
            std::thread::sleep(Duration::from_micros(200));
        }
        for message in messages {
            self.take(&message);
            if let Some(ack) = self.input.take_ack() {
                let ack = self.message(SESSION, (StreamId::NONE, 0), &ack);
                self.send(&ack);
            }
        }
        if self.sent.elapsed() > AGAIN && matches!(self.io, Io::Udp(_)) {
            self.sent = Instant::now();
            let kept = std::mem::take(&mut self.kept);
            kept.iter().for_each(|(_, message)| self.send(message));
            self.kept = kept;
        }
    }

    fn take(&mut self, message: &[u8]) {
        let message = Message::parse(message).unwrap();
        let got = &mut self.got;
        let mut data = |body: &Body<'_>| {
            if let Body::Data(data) = body {
                got.push(data.payload.to_vec());
            }
        };
        if message.header.stream.is_reliable() {
            let seq = message.header.seq;
            return self.input.receive(seq, message.body, |submessage| {
                data(&submessage.body().unwrap());
            });
        }
        for submessage in message.submessages() {
            match submessage.unwrap().body().unwrap() {
                Body::AckNack(ack) => {
                    let first = ack.first_unacked;
                    self.kept.retain(|(seq, _)| !first.is_after(SeqNum(*seq)));
                }
                Body::Heartbeat(heartbeat) => self.input.heartbeat(heartbeat.last),
                Body::StatusAgent(_) => self.is_in = true,
                body => data(&body),
            }
        }
    }
}

/// A run of `samples` samples in bursts of 40 at a kilohertz, until nothing comes for `quiet`: the
/// number that arrived, none before an earlier one, and the median of their delays.
pub(crate) fn bursts(
    at: At,
    key: u8,
    stream: StreamId,
    samples: usize,
    quiet: Duration,
) -> (usize, Duration) {
    let topic = format!("stock{key}");
    let mut writer = Stock::new(at, key);
    let mut listener = Stock::new(at, key + 1);
    writer.equip((&topic, "T"), KEEP_TEN, None);
    listener.equip((&topic, "T"), KEEP_TEN, Some(KEEP_TEN));
    listener.read(stream);
    let start = Instant::now();
    let now = || u64::try_from(start.elapsed().as_nanos()).unwrap();
    let (mut written, mut delays, mut expected) = (0, Vec::new(), 0);
    let mut last = Instant::now();
    while expected < samples && last.elapsed() < quiet {
        let due = start.elapsed().as_millis() as usize / BURST * BURST;
        let due = due.min(samples).min(expected + UNDER_WAY);
        while written < due && (!stream.is_reliable() || writer.under_way() < HISTORY) {
            let number = u32::try_from(written).unwrap().to_le_bytes();
            let sample = [&number[..], &now().to_le_bytes(), &[7; 12]].concat();
            writer.write(stream, &sample);
            written += 1;
            last = Instant::now();
        }
        writer.turn();
        listener.turn();
        for sample in std::mem::take(&mut listener.got) {
            let number = u32::from_le_bytes(sample[..4].try_into().unwrap()) as usize;
            assert!(number >= expected, "{number} after {expected}");
            expected = number + 1;
            let sent = u64::from_le_bytes(sample[4..12].try_into().unwrap());
            delays.push(now() - sent);
            last = Instant::now();
        }
    }
    delays.sort_unstable();
    let median = delays.get(delays.len() / 2).copied().unwrap_or(0);
    (delays.len(), Duration::from_nanos(median))
}
