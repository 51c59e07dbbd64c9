//! Bursts on TCP, and connections that their clients do not read: others are served as if they were
//! not there.

use crate::support::reader;
use replenish_agent::{Agent, AgentConfig, RunningAgent};
use replenish_testkit::steal;
use replenish_xrce::SeqNum;
use replenish_xrce::framing::{Prefixed, prefix};
use replenish_xrce::wire::{
    BaseRequest, Body, ClientKey, Create, CreateClient, CreationMode, DataWriterBinary,
    DeliveryControl, Encode, Entity, GetInfo, GroupBinary, Header, Message, MessageWriter,
    ObjectId, ObjectKind, ParticipantBinary, Properties, ReadData, Representation, RequestId,
    SessionId, StreamId, TopicBinary, VENDOR, VERSION, WriteData,
};
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream, UdpSocket};
use std::time::{Duration, Instant};

const SESSION: SessionId = SessionId(0x81);

/// The longest time that any step may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// A client on TCP that says everything without waiting for an answer.
struct Raw {
    stream: TcpStream,
    key: ClientKey,
    next: u16,
    decoder: Prefixed<Vec<u8>>,
}

impl Raw {
    /// A client of topic `topic` with a writer and a reader, which keeps the last 10.
    fn open(agent: SocketAddr, key: u8, topic: &str) -> Self {
        let mut raw = Self::writer(agent, key, topic);
        let read = ReadData {
            base: base(ObjectKind::DataReader),
            stream: StreamId::BEST_EFFORT,
            filter: None,
            control: Some(DeliveryControl::UNLIMITED),
        };
        let bytes = raw.message(SESSION, StreamId::NONE, &read);
        raw.stream.write_all(&bytes).unwrap();
        raw
    }

    /// The same, which does not ask for any sample.
    fn writer(agent: SocketAddr, key: u8, topic: &str) -> Self {
        let stream = TcpStream::connect(agent).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut raw = Self {
            stream,
            key: ClientKey([key; 4]),
            next: 0,
            decoder: Prefixed::new(vec![0; 65_535]),
        };
        let login = CreateClient {
            version: VERSION,
            vendor: VENDOR,
            key: raw.key,
            session: SESSION,
            properties: Properties::None,
            mtu: 512,
        };
        let mut bytes = raw.message(SESSION.before_login(), StreamId::NONE, &login);
        let id = |kind| ObjectId::new(1, kind);
        let participant = id(ObjectKind::Participant);
        let group = || Representation::Binary(GroupBinary::default());
        let repr = Representation::Binary(TopicBinary {
            name: topic,
            type_reference: None,
            type_name: Some("T"),
        });
        let writer = DataWriterBinary {
            topic: id(ObjectKind::Topic),
            qos: None,
        };
        let node = Entity::Participant {
            repr: Representation::Binary(ParticipantBinary::default()),
            domain: 0,
        };
        let entities = [
            (ObjectKind::Participant, node),
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
                    repr: Representation::Binary(writer),
                    publisher: id(ObjectKind::Publisher),
                },
            ),
            (ObjectKind::DataReader, reader(1, 10)),
        ];
        for (kind, entity) in entities {
            let base = base(kind);
            let mode = CreationMode::default();
            bytes.extend(raw.message(SESSION, StreamId::NONE, &Create { base, mode, entity }));
        }
        raw.stream.write_all(&bytes).unwrap();
        raw
    }

    fn message(&self, session: SessionId, stream: StreamId, body: &impl Encode) -> Vec<u8> {
        let header = Header::new(session, stream, SeqNum(self.next), self.key);
        let mut buf = [0; 9000];
        let mut message = MessageWriter::new(&mut buf, &header).unwrap();
        message.push_padded(body).unwrap();
        let message = message.finish();
        [&prefix(message.len()).unwrap(), message].concat()
    }

    /// A sample, ready to be sent.
    fn sample(&mut self, payload: &[u8]) -> Vec<u8> {
        let base = base(ObjectKind::DataWriter);
        let bytes = self.message(SESSION, StreamId::BEST_EFFORT, &WriteData { base, payload });
        self.next = self.next.wrapping_add(1);
        bytes
    }

    /// The next samples that arrive; none if none comes in time.
    fn receive(&mut self) -> Vec<Vec<u8>> {
        let mut samples = Vec::new();
        let mut buf = [0; 4096];
        while samples.is_empty() {
            let len = match self.stream.read(&mut buf) {
                Ok(len) if len > 0 => len,
                _ => return samples,
            };
            self.decoder.push(&buf[..len], |bytes| {
                for submessage in Message::parse(bytes).unwrap().submessages() {
                    if let Body::Data(data) = submessage.unwrap().body().unwrap() {
                        samples.push(data.payload.to_vec());
                    }
                }
            });
        }
        samples
    }

    fn receive_all(&mut self, count: usize) -> usize {
        let mut got = 0;
        while got < count {
            match self.receive().len() {
                0 => break,
                more => got += more,
            }
        }
        got
    }
}

fn base(kind: ObjectKind) -> BaseRequest {
    BaseRequest {
        request: RequestId(10),
        object: ObjectId::new(1, kind),
    }
}

fn start() -> RunningAgent {
    let config = AgentConfig {
        addr: (Ipv4Addr::LOCALHOST, 0).into(),
        tcp: Some((Ipv4Addr::LOCALHOST, 0).into()),
        ..AgentConfig::default()
    };
    Agent::bind(&config).unwrap().spawn().unwrap()
}

/// The agent took a whole read in before it sent anything: of a burst of 40 samples, which a stock
/// client with Nagle's algorithm sends, a reader that keeps the last 10 got 10.
#[test]
fn a_burst_passes_through_a_short_queue() {
    let agent = start();
    let mut client = Raw::open(agent.tcp_addr().unwrap(), 1, "burst");
    let burst: Vec<u8> = (0..40).flat_map(|i| client.sample(&[i; 20])).collect();
    client.stream.write_all(&burst).unwrap();
    assert_eq!(client.receive_all(40), 40);
    assert_eq!(agent.stats().samples_dropped, 0);
}

/// The kernel held TCP's acknowledgements back for 40 ms, and a client with Nagle's algorithm, as
/// stock ones have it, sent its samples in bursts that far apart: 18 of 300 were lost.
#[test]
fn a_client_with_nagle_s_algorithm_is_acknowledged_at_once() {
    steal::unstalled("nagle", &nagle);
}

fn nagle() {
    let agent = start();
    let mut reader = Raw::open(agent.tcp_addr().unwrap(), 2, "b");
    // The writer gets nothing back, which would carry acknowledgements.
    let mut writes = Raw::writer(agent.tcp_addr().unwrap(), 3, "b");
    writes.stream.set_nodelay(false).unwrap();
    let start = Instant::now();
    let thread = std::thread::spawn(move || {
        for _ in 0..300 {
            let sent = u64::try_from(start.elapsed().as_nanos()).unwrap();
            let bytes = writes.sample(&sent.to_le_bytes());
            writes.stream.write_all(&bytes).unwrap();
            std::thread::sleep(Duration::from_millis(1));
        }
        writes
    });
    let mut lags = Vec::new();
    while lags.len() < 300 {
        let samples = reader.receive();
        assert!(!samples.is_empty(), "{} of 300 arrived", lags.len());
        let now = start.elapsed();
        for sample in samples {
            let sent = Duration::from_nanos(u64::from_le_bytes(sample.try_into().unwrap()));
            lags.push(now.saturating_sub(sent));
        }
    }
    drop(thread.join().unwrap());
    lags.sort();
    println!("lag: p50 {:?}, p99 {:?}", lags[150], lags[297]);
    assert!(lags[150] < Duration::from_millis(15), "{:?}", lags[150]);
}

/// The round trip of pings over UDP while samples for the others arrive: the least median of ten,
/// since others of this machine make some of them longer.
fn round_trip(agent: &RunningAgent, noise: &mut Raw) -> Duration {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(agent.local_addr()).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let session = SESSION.before_login();
    let header = Header::new(session, StreamId::NONE, SeqNum(0), ClientKey([9; 4]));
    let get = GetInfo {
        base: BaseRequest {
            request: RequestId(10),
            object: ObjectId::AGENT,
        },
        mask: 0,
    };
    let mut buf = [0; 100];
    let mut message = MessageWriter::new(&mut buf, &header).unwrap();
    message.push_padded(&get).unwrap();
    let ping = message.finish().to_vec();
    let mut ping = || {
        let bytes = noise.sample(&[0; 400]);
        noise.stream.write_all(&bytes).unwrap();
        let start = Instant::now();
        socket.send(&ping).unwrap();
        socket.recv(&mut [0; 100]).unwrap();
        start.elapsed()
    };
    let medians = (0..10).map(|_| {
        let mut times: Vec<Duration> = (0..100).map(|_| ping()).collect();
        times.sort();
        times[50]
    });
    medians.min().unwrap()
}

/// Every datagram looked for the clients of every link that takes nothing: with 60 of them the
/// round trip of others went from 38 to 170 us.
#[test]
fn connections_that_nobody_reads_cost_others_little() {
    steal::unstalled("stuck connections", &stuck_connections);
}

fn stuck_connections() {
    let limits = replenish_agent::Limits {
        unauthenticated_per_second: 0,
        clients: 80,
        silence: 3_600_000_000_000, // the stuck ones never show that they live
        ..Default::default()
    };
    let config = AgentConfig {
        addr: (Ipv4Addr::LOCALHOST, 0).into(),
        tcp: Some((Ipv4Addr::LOCALHOST, 0).into()),
        limits,
        ..AgentConfig::default()
    };
    let agent = Agent::bind(&config).unwrap().spawn().unwrap();
    let addr = agent.tcp_addr().unwrap();
    let mut noise = Raw::open(addr, 100, "none");
    let alone = round_trip(&agent, &mut noise);
    let stuck: Vec<Raw> = (1..=60).map(|key| Raw::open(addr, key, "flood")).collect();
    let mut flood = Raw::open(addr, 101, "flood");
    flood.stream.set_nonblocking(true).unwrap();
    // Until their buffers are full: nothing is sent to them any more.
    let (mut out, mut quiet) = (0, 0);
    while quiet < 20 {
        let bytes = flood.sample(&[0; 480]);
        let end = Instant::now() + PATIENCE;
        let mut rest = &bytes[..];
        while !rest.is_empty() {
            assert!(Instant::now() < end, "the agent reads no more");
            match flood.stream.write(rest) {
                Ok(len) => rest = &rest[len..],
                Err(e) if e.kind() == ErrorKind::WouldBlock => {}
                Err(e) => panic!("{e}"),
            }
            // Its own samples.
            while flood.stream.read(&mut [0; 4096]).is_ok_and(|len| len > 0) {}
        }
        if flood.next.is_multiple_of(100) {
            std::thread::sleep(Duration::from_millis(1));
            let now = agent.stats().samples_out;
            quiet = if now < out + 300 { quiet + 1 } else { 0 };
            out = now;
        }
    }
    let beside = round_trip(&agent, &mut noise);
    println!("round trip of others: {alone:?} alone, {beside:?} beside 60 stuck connections");
    assert!(stuck.len() == 60 && agent.stats().clients == 62);
    assert!(beside < alone * 2, "{alone:?} {beside:?}");
}
