//! Two of our clients and the agent over real UDP on loopback.

use crate::session::{Client, MS, WRITER, endpoints, session};
use replenish_agent::{Agent, AgentConfig, RunningAgent};
use replenish_msg::std_msgs::{Int32, UInt8MultiArray};
use replenish_msg::{Message, decode, encode};
use replenish_xrce::client::{Event, SessionState};
use replenish_xrce::wire::StreamId;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A client on a socket.
struct Live {
    socket: UdpSocket,
    session: Client,
    start: Instant,
    got: Vec<Vec<u8>>,
}

impl Live {
    fn new(agent: SocketAddr, key: u8) -> Self {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        socket.connect(agent).unwrap();
        Self {
            socket,
            session: session(key, 900 * MS),
            start: Instant::now(),
            got: Vec::new(),
        }
    }

    fn open(agent: SocketAddr, key: u8, writes: &str, reads: &str, stream: StreamId) -> Self {
        let mut live = Self::new(agent, key);
        endpoints(&mut live.session, writes, reads, stream);
        live.session.connect(live.now());
        live.until(|live| live.session.state() == SessionState::Up);
        live
    }

    fn now(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap()
    }

    fn until(&mut self, done: impl Fn(&Self) -> bool) {
        let deadline = Instant::now() + Duration::from_secs(60);
        let mut buf = [0; 2048];
        loop {
            while let Some(bytes) = self
                .session
                .poll_transmit(self.start.elapsed().as_nanos() as u64)
            {
                self.socket.send(bytes).unwrap();
            }
            if done(self) {
                return;
            }
            assert!(
                Instant::now() < deadline,
                "in vain: {:?}",
                self.session.state()
            );
            let wait = self
                .session
                .next_deadline()
                .map_or(100_000_000, |deadline| {
                    deadline.saturating_sub(self.now()).clamp(1000, 100_000_000)
                });
            self.socket
                .set_read_timeout(Some(Duration::from_nanos(wait)))
                .unwrap();
            let now = self.now();
            let got = &mut self.got;
            let mut keep = |event: Event<'_>| {
                if let Event::Data { payload, .. } = event {
                    got.push(payload.to_vec());
                }
            };
            match self.socket.recv(&mut buf) {
                Ok(len) => drop(self.session.handle(now, &buf[..len], &mut keep)),
                Err(_timeout) => {}
            }
            self.session.tick(now, &mut keep);
        }
    }

    fn write(&mut self, stream: StreamId, payload: &[u8]) {
        self.session.write(WRITER, stream, payload).unwrap();
    }

    /// The next sample.
    fn read(&mut self) -> Vec<u8> {
        self.until(|live| !live.got.is_empty());
        self.got.remove(0)
    }

    fn close(mut self) {
        self.session.close(self.now());
        self.until(|live| live.session.state() == SessionState::Idle);
    }
}

fn agent() -> RunningAgent {
    let addr = (Ipv4Addr::LOCALHOST, 0).into();
    Agent::bind(&AgentConfig {
        addr,
        ..AgentConfig::default()
    })
    .unwrap()
    .spawn()
    .unwrap()
}

/// A client that answers each of `count` samples with the same bytes.
fn echo(agent: SocketAddr, stream: StreamId, count: usize) -> JoinHandle<()> {
    let mut live = Live::open(agent, 2, "pong", "ping", stream);
    std::thread::spawn(move || {
        for _ in 0..count {
            let sample = live.read();
            live.write(stream, &sample);
        }
        live.until(|live| live.session.is_delivered());
        live.close();
    })
}

fn bytes<M: Message>(message: &M) -> Vec<u8> {
    let mut buf = vec![0; M::MAX_SIZE];
    let len = encode(message, &mut buf).unwrap();
    buf.truncate(len);
    buf
}

#[test]
fn int32_there_and_back() {
    for stream in [StreamId::BEST_EFFORT, StreamId::RELIABLE] {
        let agent = agent();
        let echo = echo(agent.local_addr(), stream, 300);
        let mut ping = Live::open(agent.local_addr(), 1, "ping", "pong", stream);
        for data in 0..300 {
            ping.write(stream, &bytes(&Int32 { data }));
            let mut back = Int32::default();
            decode(&mut back, &ping.read()).unwrap();
            assert_eq!(back.data, data);
        }
        echo.join().unwrap();
        ping.close();
        let stats = agent.stop().unwrap();
        assert_eq!(
            (stats.samples_in, stats.samples_out, stats.samples_dropped),
            (600, 600, 0)
        );
        assert_eq!((stats.malformed, stats.refused, stats.clients), (0, 0, 0));
    }
}

#[test]
fn four_kilobytes_there_and_back() {
    let agent = agent();
    let stream = StreamId::RELIABLE;
    let echo = echo(agent.local_addr(), stream, 50);
    let mut ping = Live::open(agent.local_addr(), 1, "ping", "pong", stream);
    for i in 0..50_u8 {
        let mut array = UInt8MultiArray::default();
        array
            .data
            .extend((0..4096_usize).map(|at| (at % 251) as u8 ^ i));
        ping.write(stream, &bytes(&array));
        let mut back = UInt8MultiArray::default();
        decode(&mut back, &ping.read()).unwrap();
        assert_eq!(back, array);
    }
    echo.join().unwrap();
    ping.close();
    assert_eq!(agent.stop().unwrap().samples_out, 100);
}

#[test]
fn an_agent_that_starts_again_is_found_again() {
    let first = agent();
    let addr = first.local_addr();
    let mut client = Live::open(addr, 1, "loop", "loop", StreamId::RELIABLE);
    client.write(StreamId::RELIABLE, b"once");
    assert_eq!(client.read(), b"once");
    first.stop().unwrap();

    let second = Agent::bind(&AgentConfig {
        addr,
        ..AgentConfig::default()
    })
    .unwrap();
    let second = second.spawn().unwrap();
    client.until(|live| live.session.state() != SessionState::Up);
    client.until(|live| live.session.state() == SessionState::Up);
    client.write(StreamId::RELIABLE, b"more");
    assert_eq!(client.read(), b"more");
    assert_eq!(second.stats().clients, 1);
}
