//! The session, driven like the captured clients, sends what they sent, byte for byte, in every
//! scenario, and understands what the agents answered.
//!
//! The application's calls are read off the captured datagrams (a CREATE is a call of `create`, a
//! sample that was not sent before a call of `write`, ...); ids, numbers, packing, fragments,
//! acknowledgements, heartbeats, retransmissions and log-in are the session's own doing.

use std::collections::{BTreeMap, VecDeque};

use crate::common::{Datagram, assert_same, scenario};
use replenish_xrce::SeqNum;
use replenish_xrce::client::{
    Buffers, Config, Event, PingPolicy, ReliableBuffers, Session, SessionState, WriteError,
};
use replenish_xrce::stream::Reliability;
use replenish_xrce::wire::{Body, Message, ObjectId, Status, StreamId, SubmessageId};

type Client = Session<Vec<u8>, 128, 16>;

/// The session's events.
#[derive(Default)]
struct Told {
    up: usize,
    closed: usize,
    statuses: Vec<Status>,
    samples: Vec<Vec<u8>>,
    times: Vec<i64>,
}

impl Told {
    fn note(&mut self, event: Event<'_>) {
        match event {
            Event::Up => self.up += 1,
            Event::Closed => self.closed += 1,
            Event::Status { status, .. } => self.statuses.push(status),
            Event::Data { payload, .. }
            | Event::Request { payload, .. }
            | Event::Reply { payload, .. } => self.samples.push(payload.to_vec()),
            Event::Time(reply) => self.times.push(reply.offset(reply.originate)),
            other => panic!("unexpected {other:?}"),
        }
    }
}

/// One captured client, played back.
struct Playback {
    session: Client,
    told: Told,
    /// Captured, not yet handled.
    arrived: VecDeque<Datagram>,
    /// The next number of each output stream that the application has not filled.
    next: BTreeMap<u8, SeqNum>,
}

/// Whether the client answers it with an ACKNACK.
fn is_acknowledged(datagram: &Datagram) -> bool {
    let message = Message::parse(&datagram.bytes).unwrap();
    message.header.stream.is_reliable()
        || message
            .submessages()
            .any(|s| s.unwrap().id == SubmessageId::Heartbeat)
}

impl Playback {
    /// A client that logs in like `login`.
    fn new(login: &Datagram, pings: bool) -> Self {
        let message = Message::parse(&login.bytes).unwrap();
        let Body::CreateClient(create) = message
            .submessages()
            .next()
            .unwrap()
            .unwrap()
            .body()
            .unwrap()
        else {
            panic!("{login} is not a log-in");
        };
        let config = Config {
            session: create.session,
            mtu: create.mtu,
            retry_first: 1_000_000_000,
            ping: pings.then_some(PingPolicy {
                after: 1,
                silence_limit: u64::MAX,
            }),
            reliability: Reliability {
                in_flight: 128,
                ..Reliability::EPROSIMA
            },
            ..Config::new(create.key)
        };
        let buffers = Buffers {
            best_effort: [vec![0; 512]],
            reliable: [ReliableBuffers {
                output: vec![0; 128 * usize::from(create.mtu)],
                large_output: Vec::new(),
                input: vec![0; 16 * 512],
                fragments: vec![0; 66_000],
            }],
            journal: vec![0; 4096],
            restore: Vec::new(),
        };
        let mut session = Session::new(config, buffers);
        session.connect(login.time);
        Playback {
            session,
            told: Told::default(),
            arrived: VecDeque::new(),
            next: BTreeMap::new(),
        }
    }

    fn handle_next(&mut self, now: u64) -> bool {
        let Some(datagram) = self.arrived.pop_front() else {
            return false;
        };
        let told = &mut self.told;
        let (time, idle) = (
            now.min(datagram.time),
            self.session.state() == SessionState::Idle,
        );
        self.session
            .handle(time, &datagram.bytes, &mut |event| told.note(event));
        let rejected = self.session.link_stats().rejected > 0;
        assert_eq!(rejected, idle, "{datagram} was rejected: {rejected}");
        true
    }

    /// Handles what the captured client has surely handled: what needs no answer.
    fn handle_unanswered(&mut self, now: u64) {
        while self
            .arrived
            .front()
            .is_some_and(|datagram| !is_acknowledged(datagram))
        {
            self.handle_next(now);
        }
    }

    /// Does what the application did to make the client send `expected`.
    fn act(&mut self, expected: &Datagram) {
        let message = Message::parse(&expected.bytes).unwrap();
        let (stream, seq) = (message.header.stream, message.header.seq);
        let next = self.next.entry(stream.0).or_insert(SeqNum(0));
        if stream != StreamId::NONE {
            if seq != *next {
                return; // a retransmission
            }
            *next = seq.plus(1);
        }
        for submessage in message.submessages() {
            match submessage.unwrap().body().unwrap() {
                Body::Create(create) => {
                    self.session
                        .create(create.base.object, create.mode, &create.entity)
                        .unwrap();
                }
                Body::ReadData(read) => {
                    let control = read.control.unwrap();
                    self.session
                        .read(read.base.object, read.stream, control)
                        .unwrap();
                }
                Body::WriteData(write) => {
                    self.write(expected, write.base.object, stream, write.payload);
                }
                Body::Fragment(first) if seq == SeqNum(1) => {
                    // The capture ends before the last fragment: its sample is 50 000 times 'A'.
                    let object = ObjectId::from_bytes([first.piece[6], first.piece[7]]);
                    let mut sample = first.piece[8..16].to_vec();
                    sample.extend([b'A'; 49_999]);
                    sample.push(0);
                    self.write(expected, object, stream, &sample);
                }
                Body::Delete(delete) if delete.base.object == ObjectId::CLIENT => {
                    if self.session.state() != SessionState::Closing {
                        self.session.close(expected.time);
                    }
                }
                Body::Timestamp(time) => self.session.request_time(time.transmit).unwrap(),
                Body::Fragment(_)
                | Body::CreateClient(_)
                | Body::GetInfo(_)
                | Body::AckNack(_)
                | Body::Heartbeat(_) => {}
                other => panic!("{expected}: {other:?}"),
            }
        }
    }

    fn write(&mut self, expected: &Datagram, object: ObjectId, stream: StreamId, sample: &[u8]) {
        loop {
            match self.session.write(object, stream, sample) {
                Ok(()) => return,
                Err(WriteError::Down) if self.handle_next(expected.time) => {}
                Err(error) => panic!("{expected}: {error}"),
            }
        }
    }

    /// The session sends `expected`, after handling as much as it takes.
    fn expect(&mut self, expected: &Datagram) {
        let mut now = expected.time;
        self.handle_unanswered(now);
        self.act(expected);
        if expected.annotations[0].starts_with("HEARTBEAT") {
            // The captured client counts in milliseconds, so its 100 ms can be a little less.
            let due = self.session.next_deadline().unwrap();
            assert!(
                due <= now + 1_000_000,
                "{expected} comes early, ours is due at {due}"
            );
            now = now.max(due);
        }
        loop {
            self.handle_unanswered(now);
            let told = &mut self.told;
            self.session.tick(now, &mut |event| told.note(event));
            if let Some(made) = self.session.poll_transmit(now) {
                assert_same(expected, made);
                return;
            }
            assert!(
                self.handle_next(now),
                "{expected}: the session sends nothing"
            );
        }
    }
}

/// Plays back the client on `port`; returns its events.
fn play(name: &str, port: u16) -> Told {
    let datagrams: Vec<Datagram> = scenario(name)
        .into_iter()
        .filter(|datagram| datagram.client_port == port)
        .collect();
    // A ping before the log-in is no session's business.
    let is_login = |datagram: &Datagram| datagram.annotations[0].starts_with("CREATE_CLIENT");
    let start = datagrams.iter().position(is_login).unwrap();
    let pings = datagrams
        .iter()
        .any(|datagram| datagram.annotations[0].starts_with("GET_INFO"));
    let mut playback = Playback::new(&datagrams[start], pings);
    let mut end = 0;
    for datagram in datagrams.into_iter().skip(start) {
        end = datagram.time;
        if datagram.from_client {
            playback.expect(&datagram);
        } else {
            playback.arrived.push_back(datagram);
        }
    }
    while playback.handle_next(end) {}
    assert_eq!(playback.told.up, 1, "{name}");
    assert!(
        playback.told.statuses.iter().all(|status| status.is_ok()),
        "{name}"
    );
    playback.told
}

/// The samples that `Hello DDS world!` with these numbers is.
fn hello(numbers: impl IntoIterator<Item = u32>) -> Vec<Vec<u8>> {
    let sample = |number: u32| {
        [
            &number.to_le_bytes()[..],
            &17_u32.to_le_bytes(),
            b"Hello DDS world!\0",
        ]
        .concat()
    };
    numbers.into_iter().map(sample).collect()
}

#[test]
fn binary() {
    let told = play("binary", 35901);
    assert_eq!((told.statuses.len(), told.closed), (6, 1));
    let expected: Vec<_> = (0_u32..5)
        .map(|number| number.to_le_bytes().to_vec())
        .collect();
    assert_eq!(told.samples, expected);
}

#[test]
fn reliable() {
    let reader = play("reliable", 41301);
    assert_eq!(reader.samples, hello(2..=5));
    let writer = play("reliable", 60925);
    assert_eq!((writer.statuses.len(), writer.closed), (4, 1));
    play("reliable", 34233);
}

#[test]
fn best_effort() {
    assert_eq!(play("besteffort", 49905).samples, hello(1..=4));
    assert_eq!(play("besteffort", 48584).closed, 1);
}

#[test]
fn loss() {
    let reader = play("loss", 60017);
    assert_eq!((reader.samples, reader.closed), (hello(3..=8), 1));
    assert_eq!(play("loss", 55851).closed, 1);
}

#[test]
#[cfg_attr(not(feature = "queries"), ignore = "needs the feature `queries`")]
fn time_synchronisation() {
    assert_eq!(play("timesync", 43301).times.len(), 4);
}

#[test]
#[cfg_attr(not(feature = "services"), ignore = "needs the feature `services`")]
fn requests_and_replies() {
    let ports: std::collections::BTreeSet<u16> = scenario("reqrep")
        .iter()
        .map(|datagram| datagram.client_port)
        .collect();
    assert_eq!(ports.len(), 2);
    for port in ports {
        assert!(!play("reqrep", port).samples.is_empty());
    }
}

#[test]
fn tcp() {
    play("tcp", 58582);
}

#[test]
#[cfg_attr(not(feature = "fragments"), ignore = "needs the feature `fragments`")]
fn fragments() {
    play("fragment (first 120 datagrams)", 42367);
    play("fragment (first 120 datagrams)", 43434);
}

#[test]
fn newer_agent() {
    let name = "reliable, agent v3.0.1 (Fast DDS 3.2.3)";
    assert_eq!(play(name, 39842).samples, hello(4..=5));
    assert_eq!(play(name, 33315).closed, 1);
    play(name, 43176);
}

/// Nothing of the capture is left out: every client of every scenario is played above.
#[test]
fn all_scenarios_and_clients() {
    let mut clients = std::collections::BTreeSet::new();
    for datagram in crate::common::capture() {
        clients.insert((datagram.scenario, datagram.client_port));
    }
    let played = [
        ("besteffort", 48584),
        ("besteffort", 49905),
        ("binary", 35901),
        ("fragment (first 120 datagrams)", 42367),
        ("fragment (first 120 datagrams)", 43434),
        ("loss", 55851),
        ("loss", 60017),
        ("reliable", 34233),
        ("reliable", 41301),
        ("reliable", 60925),
        ("reliable, agent v3.0.1 (Fast DDS 3.2.3)", 33315),
        ("reliable, agent v3.0.1 (Fast DDS 3.2.3)", 39842),
        ("reliable, agent v3.0.1 (Fast DDS 3.2.3)", 43176),
        ("tcp", 58582),
        ("timesync", 43301),
    ];
    let played = played.map(|(name, port)| (name.to_string(), port));
    // In one direction what was captured was lost afterwards: it is not known what these two
    // received.
    let unknown = [("loss", 36287), ("loss", 50924)];
    let unknown = unknown.map(|(name, port)| (name.to_string(), port));
    let mut others: Vec<_> = clients.difference(&played.into()).cloned().collect();
    others.retain(|client| !unknown.contains(client));
    assert!(
        others.len() == 2 && others.iter().all(|(name, _)| name == "reqrep"),
        "{others:?}"
    );
}

/// Pings outside of sessions, which the clients sent before their log-in.
#[test]
fn pings_without_a_session() {
    let mut pings = 0;
    let mut answers = 0;
    let mut asked = None;
    for datagram in crate::common::capture() {
        let message = Message::parse(&datagram.bytes).unwrap();
        if !message.header.session.is_none() {
            continue;
        }
        for submessage in message.submessages() {
            match submessage.unwrap().body().unwrap() {
                Body::GetInfo(get) => {
                    let mut buf = [0; 64];
                    let key = message.header.key;
                    let made = replenish_xrce::client::ping(get.base.request, key, &mut buf);
                    crate::common::assert_same(&datagram, made.unwrap());
                    asked = Some(get.base.request);
                    pings += 1;
                }
                Body::Info(_) => {
                    let info = replenish_xrce::client::pong(asked.unwrap(), &datagram.bytes);
                    assert!(info.is_some(), "{datagram}");
                    answers += 1;
                }
                _ => {}
            }
        }
    }
    assert!(pings > 0 && answers == pings, "{pings} {answers}");
}
