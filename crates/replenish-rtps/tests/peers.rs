//! Foreign implementations against ours: genuine ROS 2 (rclpy of Kilted, Fast DDS) and Cyclone DDS.
//! `tests/peers/setup.sh` installs them; without it these trials count as ignored.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    reason = "test code"
)]

#[path = "../../../firmware/src/talker.rs"]
#[allow(unreachable_pub, reason = "a part of the firmware's library")]
mod talker;

use replenish_rtps::participant::{EndpointSpec, ReaderId, WriterId};
use replenish_rtps::ros::{
    GRAPH_QOS, GRAPH_TOPIC, GRAPH_TYPE, GidSize, Node, Prefix, dds_topic, dds_type, encode_graph,
};
use replenish_rtps::udp::{UdpConfig, UdpParticipant};
use replenish_rtps::wire::{CDR_LE, GuidPrefix, Qos, TypeHash};
use replenish_testkit::domain::domain;
use replenish_testkit::harness::{peer_trial, run};
use replenish_testkit::peer::{self, Peer};
use std::collections::VecDeque;
use std::net::{Ipv4Addr, Ipv6Addr, UdpSocket};
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

/// The longest time that any step may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);
/// RIHS01 of `std_msgs/msg/String`, as rclpy shows it.
const STRING: &str = "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
/// The same of `std_msgs/msg/Int32`.
const INT32: &str = "b6578ded3c58c626cfe8d1a6fb6e04f706f97e9f03d2727c9ff4e74b1cef0deb";

fn main() {
    let trial =
        |name, peer: &'static str, body: fn()| peer_trial(name, peer::missing(&python(peer)), body);
    run(vec![
        trial("rclpy_sends_everything_back", "kilted", || {
            echo(&RCLPY);
        }),
        trial("cyclone_sends_everything_back", "cyclonedds", || {
            echo(&CYCLONE);
        }),
        trial(
            "cyclone_sends_everything_back_over_ipv6",
            "cyclonedds",
            || {
                echo(&CYCLONE_6);
            },
        ),
        trial("rclpy_sees_node_type_and_hash", "kilted", graph),
        trial("rclpy_hears_the_talker_of_a_board", "kilted", || {
            let graph = format!("std_msgs/msg/Int32 RIHS01_{INT32}");
            board_talker("kilted", "rclpy_listener.py", Some(&graph));
        }),
        trial("cyclone_hears_the_talker_of_a_board", "cyclonedds", || {
            board_talker("cyclonedds", "cyclone_listener.py", None);
        }),
    ]);
}

fn python(peer: &str) -> PathBuf {
    peer::python(env!("CARGO_TARGET_TMPDIR"), peer)
}

struct PeerKind {
    environment: &'static str,
    script: &'static str,
    /// Both are on `::1` alone.
    ipv6: bool,
}

const RCLPY: PeerKind = PeerKind {
    environment: "kilted",
    script: "rclpy_echo.py",
    ipv6: false,
};
const CYCLONE: PeerKind = PeerKind {
    environment: "cyclonedds",
    script: "cyclone_echo.py",
    ipv6: false,
};
const CYCLONE_6: PeerKind = PeerKind {
    ipv6: true,
    ..CYCLONE
};

fn start(kind: &PeerKind, domain: u16) -> Peer {
    let dir = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/peers/");
    let mut command = Command::new(python(kind.environment));
    command.arg(format!("{dir}{}", kind.script));
    if kind.ipv6 {
        command.arg("ipv6");
    }
    Peer::start(&mut command, domain)
}

/// A node with /ping, /latched and /pong.
struct Ours {
    node: UdpParticipant,
    ping: WriterId,
    latched: WriterId,
    pong: ReaderId,
    hash: TypeHash,
}

impl Ours {
    fn new(domain: u16) -> Self {
        Self::with(&UdpConfig {
            domain,
            ..UdpConfig::default()
        })
    }

    fn over_ipv6(domain: u16) -> Self {
        let local = Ipv6Addr::LOCALHOST;
        let peers: Vec<_> = UdpConfig::unicast(domain, local, 8).collect();
        Self::with(&UdpConfig {
            domain,
            interfaces: &[],
            interfaces6: &[(local, 1)],
            multicast: false,
            peers: &peers,
            ..UdpConfig::default()
        })
    }

    fn with(config: &UdpConfig<'_>) -> Self {
        let mut node = UdpParticipant::open(config).unwrap();
        let mut hash = [0; 32];
        for (byte, pair) in hash.iter_mut().zip(STRING.as_bytes().chunks(2)) {
            *byte = u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
        }
        let hash = TypeHash(hash);
        let kind = dds_type("std_msgs/msg/String").unwrap();
        let now = node.now();
        let participant = node.participant_mut();
        let topic = |name| dds_topic(Prefix::Topic, name).unwrap();
        let all = Qos {
            depth: 0,
            ..Qos::ros()
        };
        let spec = EndpointSpec {
            type_hash: Some(hash),
            sample_bytes: 200_000,
            samples: 16,
            ..EndpointSpec::new("", kind.as_str())
        };
        let (ping, latched, pong) = (topic("/ping"), topic("/latched"), topic("/pong"));
        let ping = EndpointSpec {
            topic: ping.as_str(),
            qos: all,
            ..spec
        };
        let latched = EndpointSpec {
            topic: latched.as_str(),
            qos: Qos::latched(10),
            ..spec
        };
        let pong = EndpointSpec {
            topic: pong.as_str(),
            qos: all,
            ..spec
        };
        let ping = participant.create_writer(&ping, now).unwrap();
        let latched = participant.create_writer(&latched, now).unwrap();
        let pong = participant.create_reader(&pong, now).unwrap();
        let spec = EndpointSpec {
            qos: GRAPH_QOS,
            ..EndpointSpec::new(GRAPH_TOPIC, GRAPH_TYPE)
        };
        let graph = participant.create_writer(&spec, now).unwrap();
        let own = Node {
            namespace: "/ours",
            name: "replenish",
            readers: &[pong.entity()],
            writers: &[ping.entity(), latched.entity()],
        };
        let mut buf = [0; 512];
        let prefix = participant.prefix();
        let message = encode_graph(&mut buf, prefix, &[own], GidSize::Bytes16).unwrap();
        participant.write(graph, message, None, now).unwrap();
        Ours {
            node,
            ping,
            latched,
            pong,
            hash,
        }
    }

    fn step(&mut self) {
        self.node.step(Duration::from_millis(20)).unwrap();
    }

    fn write(&mut self, writer: WriterId, sample: &[u8]) -> bool {
        let now = self.node.now();
        self.node
            .participant_mut()
            .write(writer, sample, None, now)
            .is_ok()
    }

    fn matched(&self) -> bool {
        let participant = self.node.participant();
        let readers = participant.writer(self.ping).unwrap().matched();
        readers > 0 && participant.reader(self.pong).unwrap().matched() > 0
    }
}

/// A string that says its number, `len` bytes long without the NUL.
fn sample(number: usize, len: usize) -> Vec<u8> {
    let mut text = format!("{number}:").into_bytes();
    text.resize(
        len.max(text.len()),
        b'a' + u8::try_from(number % 26).unwrap(),
    );
    text.push(0);
    let head = u32::try_from(text.len()).unwrap().to_le_bytes();
    [&CDR_LE, head.as_slice(), &text].concat()
}

/// Bytes up to the end of the string: peers pad what they send.
fn trimmed(payload: &[u8]) -> &[u8] {
    let len = u32::from_le_bytes(payload[4..8].try_into().unwrap()) as usize;
    &payload[..8 + len]
}

/// Latched samples from before the peer was there, then 200 short and long ones: all come back,
/// once and in order, longer ones than a datagram in fragments both ways.
fn echo(kind: &PeerKind) {
    let domain = domain();
    let mut ours = if kind.ipv6 {
        Ours::over_ipv6(domain)
    } else {
        Ours::new(domain)
    };
    let mut expected = VecDeque::new();
    for number in 0..3 {
        let sample = sample(number, 20 + 30_000 * number);
        let latched = ours.latched;
        assert!(ours.write(latched, &sample));
        expected.push_back(sample);
    }
    let _peer = start(kind, domain);
    let begin = Instant::now();
    let mut next = 3;
    let mut received = 0;
    while received < 203 {
        assert!(
            begin.elapsed() < PATIENCE,
            "{received} of 203 after {PATIENCE:?}"
        );
        ours.step();
        // Not before the latched ones are back: the order between two topics is not promised.
        while received >= 3 && ours.matched() && next < 203 && next - received < 8 {
            let len = if next % 10 == 0 { 150_000 } else { next * 7 };
            let (ping, sample) = (ours.ping, sample(next, len));
            if !ours.write(ping, &sample) {
                break;
            }
            expected.push_back(sample);
            next += 1;
        }
        let pong = ours.pong;
        while let Some(sample) = ours.node.participant_mut().take(pong) {
            let wanted = expected
                .pop_front()
                .expect("no more samples than were sent");
            let (got, wanted) = (trimmed(sample.payload), wanted.as_slice());
            assert!(
                got == wanted,
                "sample {received}: {:?}",
                &got[..got.len().min(24)]
            );
            received += 1;
        }
    }
    let reader = ours.node.participant().reader(ours.pong).unwrap().stats();
    assert_eq!((reader.received, reader.lost, reader.too_long), (203, 0, 0));
}

/// Node, type and type hash as genuine `get_publishers_info_by_topic` has them, and that they are
/// gone after a goodbye.
fn graph() {
    let domain = domain();
    let mut ours = Ours::new(domain);
    let hash = ours.hash;
    let peer = start(&RCLPY, domain);
    let begin = Instant::now();
    let mut wanted = vec!["publisher", "subscription"];
    while !wanted.is_empty() {
        assert!(begin.elapsed() < PATIENCE, "no line about {wanted:?}");
        ours.step();
        while let Ok(line) = peer.lines.try_recv() {
            let Some((kind, rest)) = line.split_once(' ') else {
                continue;
            };
            assert_eq!(
                rest,
                format!("replenish std_msgs/msg/String RIHS01_{STRING}")
            );
            wanted.retain(|wanted| *wanted != kind);
        }
    }
    // They may see us before we see them.
    let hashes = loop {
        assert!(begin.elapsed() < PATIENCE, "their endpoint is not seen");
        ours.step();
        let theirs = ours.node.participant().endpoints();
        let pong = theirs.filter(|known| known.topic() == "rt/pong");
        let hashes: Vec<_> = pong.map(|known| known.type_hash).collect();
        if !hashes.is_empty() {
            break hashes;
        }
    };
    assert_eq!(hashes, [Some(hash)]);
    drop(ours);
    assert_eq!(peer.lines.recv_timeout(PATIENCE).as_deref(), Ok("gone"));
}

/// The state machines of the image `talker`, with a board's bounds, on a socket of this host. ROS 2
/// also says which type and hash its graph shows.
fn board_talker(environment: &'static str, script: &'static str, graph: Option<&str>) {
    let domain = domain();
    let peer = start(
        &PeerKind {
            environment,
            script,
            ipv6: false,
        },
        domain,
    );
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    socket
        .set_read_timeout(Some(Duration::from_millis(5)))
        .unwrap();
    let own = socket.local_addr().unwrap();
    let group: Vec<_> = UdpConfig::unicast(domain, Ipv4Addr::LOCALHOST, 1).collect();
    let prefix = GuidPrefix([0, 0, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7]);
    let begin = Instant::now();
    let now = || u64::try_from(begin.elapsed().as_nanos()).unwrap() + 1;
    let mut talker = talker::Talker::new(domain.into(), prefix, own, &group, now()).unwrap();
    let (mut buf, mut datagram) = ([0; talker::DATAGRAM], [0; 65_536]);
    let (mut heard, mut seen): (Vec<i32>, _) = (Vec::new(), None);
    while heard.len() < 20 || seen.as_deref() != graph {
        assert!(
            begin.elapsed() < PATIENCE,
            "{heard:?} and {seen:?} after {PATIENCE:?}"
        );
        while let Some((len, to)) = talker.poll(&mut buf, now()) {
            socket.send_to(&buf[..len], to).unwrap();
        }
        while let Ok(len) = socket.recv(&mut datagram) {
            talker.receive(&datagram[..len], now());
        }
        for line in peer.lines.try_iter() {
            match line.strip_prefix("publisher ") {
                Some(shown) => seen = Some(shown.to_owned()),
                None => heard.push(line.parse().unwrap()),
            }
        }
    }
    let in_order: Vec<i32> = (heard[0]..).take(heard.len()).collect();
    assert_eq!(heard, in_order);
}
