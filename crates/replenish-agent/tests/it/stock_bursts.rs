//! The traffic of eProsima's client, replayed: that client cannot be had here (neither a Debian nor
//! a Python package has it), so these are its habits as they were recorded (`docs/peers.md`):
//! messages
//! of 512 bytes, no properties in the log-in, Nagle's algorithm on TCP with bursts of 40 samples,
//! four
//! reliable messages under way at most, and an ACKNACK for every reliable message.

use crate::support::reader;
use replenish_agent::{Agent, AgentConfig, RunningAgent};
use replenish_xrce::SeqNum;
use replenish_xrce::framing::{Prefixed, prefix};
use replenish_xrce::stream::InputReliable;
use replenish_xrce::wire::{
    BaseRequest, Body, ClientKey, Create, CreateClient, CreationMode, DataWriterBinary,
    DeliveryControl, Encode, Entity, GroupBinary, Header, Message, MessageWriter, ObjectId,
    ObjectKind, ParticipantBinary, Properties, ReadData, Representation, RequestId, SessionId,
    StreamId, TopicBinary, VENDOR, VERSION, WriteData,
};
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpStream, UdpSocket};
use std::time::{Duration, Instant};

const SESSION: SessionId = SessionId(0x81);

/// Samples of a run, at a kilohertz, and those of a burst.
const SAMPLES: usize = 3000;
const BURST: usize = 40;

/// Reliable messages that a stock client keeps.
const HISTORY: usize = 4;

enum Io {
    Udp(UdpSocket),
    Tcp(TcpStream, Prefixed<Vec<u8>>),
}

/// A client with one topic.
struct Stock {
    io: Io,
    key: ClientKey,
    next: [u16; 2],
    /// The first message that the agent has not acknowledged.
    unacked: u16,
    input: InputReliable<Vec<u8>, Vec<u8>, 16>,
    got: Vec<Vec<u8>>,
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
    fn new(agent: &RunningAgent, tcp: bool, key: u8) -> Self {
        let io = if tcp {
            let stream = TcpStream::connect(agent.tcp_addr().unwrap()).unwrap();
            stream.set_nonblocking(true).unwrap();
            Io::Tcp(stream, Prefixed::new(vec![0; 65_535]))
        } else {
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            socket.connect(agent.local_addr()).unwrap();
            socket.set_nonblocking(true).unwrap();
            Io::Udp(socket)
        };
        let input =
            InputReliable::new(StreamId::RELIABLE, vec![0; 16 * 512], 512, vec![0; 1 << 10]);
        let mut client = Self {
            io,
            key: ClientKey([key; 4]),
            next: [0; 2],
            unacked: 0,
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
        client.message(SESSION.before_login(), (StreamId::NONE, 0), &login);
        let end = Instant::now() + Duration::from_secs(10);
        while !client.is_in {
            assert!(Instant::now() < end, "no answer to the log-in");
            client.turn();
        }
        client
    }

    /// Participant, topic, publisher, subscriber, writer and reader, as a stock client creates
    /// them:
    /// each is acknowledged before the next one.
    fn equip(&mut self, topic: &str, reads: bool) {
        let id = |kind| ObjectId::new(1, kind);
        let participant = id(ObjectKind::Participant);
        let group = || Representation::Binary(GroupBinary::default());
        let repr = Representation::Binary(TopicBinary {
            name: topic,
            type_reference: None,
            type_name: Some("T"),
        });
        let node = Representation::Binary(ParticipantBinary::default());
        let writer = DataWriterBinary {
            topic: id(ObjectKind::Topic),
            qos: None,
        };
        let repr_of_writer = Representation::Binary(writer);
        let publisher = id(ObjectKind::Publisher);
        let entities = [
            (
                ObjectKind::Participant,
                Entity::Participant {
                    repr: node,
                    domain: 0,
                },
            ),
            (ObjectKind::Topic, Entity::Topic { repr, participant }),
            (
                ObjectKind::Publisher,
                Entity::Publisher {
                    repr: group(),
                    participant,
                },
            ),
            (
                ObjectKind::Subscriber,
                Entity::Subscriber {
                    repr: group(),
                    participant,
                },
            ),
            (
                ObjectKind::DataWriter,
                Entity::DataWriter {
                    repr: repr_of_writer,
                    publisher,
                },
            ),
            (ObjectKind::DataReader, reader(1, 10)),
        ];
        // A reader that asks for nothing would only lose samples.
        for (kind, entity) in entities.into_iter().take(if reads { 6 } else { 5 }) {
            let mode = CreationMode::REUSE_OR_REPLACE;
            self.reliable(&Create {
                base: base(kind),
                mode,
                entity,
            });
            self.until_acknowledged();
        }
    }

    fn read(&mut self, stream: StreamId) {
        self.reliable(&ReadData {
            base: base(ObjectKind::DataReader),
            stream,
            filter: None,
            control: Some(DeliveryControl::UNLIMITED),
        });
        self.until_acknowledged();
    }

    fn until_acknowledged(&mut self) {
        let end = Instant::now() + Duration::from_secs(10);
        while self.under_way() > 0 {
            assert!(Instant::now() < end, "a request is not acknowledged");
            self.turn();
        }
    }

    fn under_way(&self) -> usize {
        usize::from(self.next[1].wrapping_sub(self.unacked))
    }

    fn reliable(&mut self, body: &impl Encode) {
        let seq = self.next[1];
        self.next[1] = seq.wrapping_add(1);
        self.message(SESSION, (StreamId::RELIABLE, seq), body);
    }

    fn write(&mut self, stream: StreamId, payload: &[u8]) {
        let base = base(ObjectKind::DataWriter);
        let body = WriteData { base, payload };
        if stream.is_reliable() {
            return self.reliable(&body);
        }
        let seq = self.next[0];
        self.next[0] = seq.wrapping_add(1);
        self.message(SESSION, (stream, seq), &body);
    }

    fn message(&mut self, session: SessionId, (on, seq): (StreamId, u16), body: &impl Encode) {
        let header = Header::new(session, on, SeqNum(seq), self.key);
        let mut buf = [0; 512];
        let mut message = MessageWriter::new(&mut buf, &header).unwrap();
        message.push_padded(body).unwrap();
        let message = message.finish();
        match &mut self.io {
            Io::Udp(socket) => drop(socket.send(message).unwrap()),
            Io::Tcp(stream, _) => {
                let bytes = [&prefix(message.len()).unwrap(), message].concat();
                assert_eq!(stream.write(&bytes).unwrap(), bytes.len());
            }
        }
    }

    /// Takes what has come, and acknowledges it.
    fn turn(&mut self) {
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
                self.message(SESSION, (StreamId::NONE, 0), &ack);
            }
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
                Body::AckNack(ack) => self.unacked = ack.first_unacked.0,
                Body::Heartbeat(heartbeat) => self.input.heartbeat(heartbeat.last),
                Body::StatusAgent(_) => self.is_in = true,
                body => data(&body),
            }
        }
    }
}

/// 3000 samples in bursts of 40 at a kilohertz; the number that arrived in order, and the median of
/// their delays.
fn run(agent: &RunningAgent, tcp: bool, stream: StreamId, key: u8) -> (usize, Duration) {
    let topic = format!("stock{key}");
    let mut writer = Stock::new(agent, tcp, key);
    let mut listener = Stock::new(agent, tcp, key + 1);
    writer.equip(&topic, false);
    listener.equip(&topic, true);
    listener.read(stream);
    let start = Instant::now();
    let now = || u64::try_from(start.elapsed().as_nanos()).unwrap();
    let (mut written, mut delays, mut expected) = (0, Vec::new(), 0);
    let mut last = Instant::now();
    while expected < SAMPLES && last.elapsed() < Duration::from_secs(5) {
        let due = start.elapsed().as_millis() as usize / BURST * BURST;
        while written < due.min(SAMPLES) && (!stream.is_reliable() || writer.under_way() < HISTORY)
        {
            let number = u32::try_from(written).unwrap().to_le_bytes();
            writer.write(
                stream,
                &[&number[..], &now().to_le_bytes(), &[7; 12]].concat(),
            );
            written += 1;
            last = Instant::now();
        }
        writer.turn();
        listener.turn();
        for sample in std::mem::take(&mut listener.got) {
            let number = u32::from_le_bytes(sample[..4].try_into().unwrap());
            assert_eq!(number as usize, expected, "in order, none missing");
            expected += 1;
            let sent = u64::from_le_bytes(sample[4..12].try_into().unwrap());
            delays.push(now() - sent);
            last = Instant::now();
        }
    }
    delays.sort_unstable();
    let median = delays.get(delays.len() / 2).copied().unwrap_or(0);
    (expected, Duration::from_nanos(median))
}

/// On b209253 a reader that keeps the last 10 lost 30 of each burst of 40 over TCP, 753 of 3000
/// arrived, and with a longer queue all, 24 ms late in the median. Prints the counts.
#[test]
fn a_stock_client_s_bursts_arrive_at_one_kilohertz() {
    let config = AgentConfig {
        addr: (Ipv4Addr::LOCALHOST, 0).into(),
        tcp: Some((Ipv4Addr::LOCALHOST, 0).into()),
        ..AgentConfig::default()
    };
    let agent = Agent::bind(&config).unwrap().spawn().unwrap();
    println!("| transport | stream | arrived | median |\n|---|---|---|---|");
    let cases = [
        (true, StreamId::RELIABLE),
        (true, StreamId::BEST_EFFORT),
        (false, StreamId::RELIABLE),
        (false, StreamId::BEST_EFFORT),
    ];
    for (key, (tcp, stream)) in (1..).step_by(2).zip(cases) {
        let (arrived, median) = run(&agent, tcp, stream, key);
        let transport = if tcp { "TCP" } else { "UDP" };
        let reliable = if stream.is_reliable() {
            "reliable"
        } else {
            "best effort"
        };
        println!("| {transport} | {reliable} | {arrived} of {SAMPLES} | {median:?} |");
        assert_eq!(arrived, SAMPLES);
    }
    assert_eq!(agent.stats().samples_dropped, 0);
}
