//! Floods that would keep others out, reflection and takeovers, on sockets; one command prints
//! them:
//! `cargo test -p replenish-bench --test it memory::floods -- --nocapture`.

use super::attacks::Target;
use super::{Scratch, Victim};
use crate::attacker::{Raw, SESSION, answer, base, host, log_in, message, questions, subscription};
use replenish_testkit::steal;
use replenish_xrce::framing::Prefixed;
use replenish_xrce::wire::{Delete, EndpointQos, ObjectId, Status, StreamId};
use std::io::Read;
use std::net::UdpSocket;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Honest log-ins during a flood, and how long one may take.
const HONEST: u32 = 100;
const IN_TIME: Duration = Duration::from_secs(2);

/// Between two tries of an honest client.
const AGAIN: Duration = Duration::from_millis(250);

/// Hosts of honest clients; attackers are below.
const ELSEWHERE: u32 = 10_000;

pub(crate) type Flood = fn(Target, &AtomicBool);
pub(crate) type Honest = fn(Target, u32) -> bool;

/// A12: one host has all places, and a sign of life from each all the time.
fn log_ins(at: Target, stop: &AtomicBool) {
    let sockets: Vec<UdpSocket> = (0..64).map(|_| host(1)).collect();
    while !stop.load(Ordering::Relaxed) {
        for (key, socket) in (0xa000..).zip(&sockets) {
            socket.send_to(&log_in(key, 512), at.udp).ok();
            socket.send_to(&questions(key, SESSION, 30), at.udp).ok();
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A13: connections without a log-in, kept alive by a byte now and then.
fn idle_connections(at: Target, stop: &AtomicBool) {
    let mut open: Vec<Raw> = Vec::new();
    while !stop.load(Ordering::Relaxed) {
        open.retain_mut(|raw| raw.bytes(&[0]));
        while open.len() < 80 {
            open.push(Raw::connect(at.tcp, 1));
        }
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// A14: junk and questions from one address, and from many ports of another host.
fn junk(at: Target, stop: &AtomicBool) {
    let (one, many) = (host(1), (0..200).map(|_| host(2)).collect::<Vec<_>>());
    let ask = questions(7, SESSION.before_login(), 30);
    while !stop.load(Ordering::Relaxed) {
        for socket in &many {
            for bytes in [&ask[..], &[0x80, 0, 0, 0, 99, 1, 2, 3]] {
                one.send_to(bytes, at.udp).ok();
                socket.send_to(bytes, at.udp).ok();
            }
            std::thread::sleep(Duration::from_micros(50));
        }
    }
}

/// Logs in over UDP from a host of its own; logs out again.
fn honest_udp(at: Target, number: u32) -> bool {
    let socket = host(ELSEWHERE + number);
    socket.set_read_timeout(Some(AGAIN)).unwrap();
    let key = 0xb000 + number;
    let mut buf = [0; 2000];
    let begin = Instant::now();
    while begin.elapsed() < IN_TIME {
        socket.send_to(&log_in(key, 512), at.udp).unwrap();
        let len = socket.recv(&mut buf).unwrap_or(0);
        if answer(&buf[..len]) == Some(Status::OK) {
            let log_out = message((key, SESSION), (StreamId::NONE, 0), |message| {
                let base = base(ObjectId::CLIENT);
                message.push_padded(&Delete { base }).unwrap();
            });
            socket.send_to(&log_out, at.udp).unwrap();
            return true;
        }
    }
    false
}

/// The same over TCP; an agent that closes the connection is asked again.
fn honest_tcp(at: Target, number: u32) -> bool {
    let begin = Instant::now();
    while begin.elapsed() < IN_TIME {
        let mut raw = Raw::connect(at.tcp, 0xb000 + number);
        raw.reads = false;
        raw.frame(&log_in(raw.key, 512));
        raw.stream.set_nonblocking(false).unwrap();
        raw.stream.set_read_timeout(Some(AGAIN)).unwrap();
        let mut decoder = Prefixed::new(vec![0; 2000]);
        let mut buf = [0; 2000];
        let mut is_in = false;
        let len = raw.stream.read(&mut buf).unwrap_or(0);
        decoder.push(&buf[..len], |bytes| {
            is_in |= answer(bytes) == Some(Status::OK);
        });
        if is_in {
            return true;
        }
    }
    false
}

/// The floods.
pub(crate) const FLOODS: [(&str, Flood, Honest); 3] = [
    ("A12: 64 log-ins from one host, lively", log_ins, honest_udp),
    (
        "A13: 80 TCP connections without log-in",
        idle_connections,
        honest_tcp,
    ),
    ("A14: junk from one address and one host", junk, honest_udp),
];

/// Number of honest clients, of `clients`, that log in within two seconds during a flood, and the
/// time of the slowest.
pub(crate) fn during(at: Target, flood: Flood, honest: Honest, clients: u32) -> (u32, Duration) {
    let stop = AtomicBool::new(false);
    let (mut in_time, mut slowest) = (0, Duration::ZERO);
    std::thread::scope(|scope| {
        scope.spawn(|| flood(at, &stop));
        std::thread::sleep(Duration::from_secs(2));
        for number in 0..clients {
            let begin = Instant::now();
            in_time += u32::from(honest(at, number));
            slowest = slowest.max(begin.elapsed());
        }
        stop.store(true, Ordering::Relaxed);
    });
    (in_time, slowest)
}

/// 100 of 100 clients log in within two seconds, whatever others do. On b209253 64 log-ins, idle
/// connections or junk kept all, all or half of them out.
#[test]
fn honest_clients_log_in_during_floods() {
    steal::unstalled("floods", &floods);
}

fn floods() {
    let scratch = Scratch::new("floods");
    println!("| flood | honest log-ins within 2 s | slowest |\n|---|---|---|");
    for (number, (name, flood, honest)) in FLOODS.into_iter().enumerate() {
        let victim = Victim::with(&scratch, &number.to_string(), &[]);
        let (in_time, slowest) = during(victim.at, flood, honest, HONEST);
        println!("| {name} | {in_time} of {HONEST} | {slowest:.0?} |");
        assert_eq!(in_time, HONEST, "{name}");
    }
}

/// Bytes from an address that acknowledges nothing, and to it, while others talk.
pub(crate) fn reflected(at: Target) -> (usize, usize) {
    let mut talker = Raw::open(at.tcp, 1, 512);
    talker.topic(1, "t");
    talker.writer(1, 1, EndpointQos::default());
    let forged = host(1);
    forged.set_nonblocking(true).unwrap();
    let mut from = 0;
    let mut send = |bytes: &[u8]| {
        forged.send_to(bytes, at.udp).unwrap();
        from += bytes.len();
        std::thread::sleep(Duration::from_millis(1));
    };
    send(&log_in(9, 512));
    subscription(9, "t").iter().for_each(|bytes| send(bytes));
    send(&questions(9, SESSION, 1400));
    send(&questions(9, SESSION.before_login(), 1400));
    let (mut to, mut buf) = (0, [0; 65_535]);
    for _ in 0..500 {
        talker.write(1, 400);
        std::thread::sleep(Duration::from_millis(1));
        while let Ok(len) = forged.recv(&mut buf) {
            to += len;
        }
    }
    (from, to)
}

/// At most three times the bytes of an address leave for it before it acknowledges anything. On
/// b209253 315 bytes made it send 701 kB.
#[test]
fn a_forged_source_is_sent_little() {
    let scratch = Scratch::new("reflection");
    let victim = Victim::with(&scratch, "r", &[]);
    let (from, to) = reflected(victim.at);
    println!(
        "reflection: {from} bytes in, {to} out: {:.2} times",
        to as f64 / from as f64
    );
    assert!(to <= 3 * from && to > 0);
}

/// No log-in takes the key of a client that answers.
#[test]
fn no_key_is_taken_over_from_a_client_that_answers() {
    steal::unstalled("takeovers", &takeovers);
}

/// The owner answers in time on a machine that keeps up.
fn takeovers() {
    let scratch = Scratch::new("takeovers");
    let victim = Victim::with(&scratch, "t", &[]);
    let owner = host(1);
    owner
        .set_read_timeout(Some(Duration::from_millis(5)))
        .unwrap();
    owner.send_to(&log_in(5, 512), victim.at.udp).unwrap();
    let thieves: Vec<UdpSocket> = (2..52).map(host).collect();
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(4) {
        for thief in &thieves {
            thief.send_to(&log_in(5, 512), victim.at.udp).unwrap();
        }
        // Anything from its address shows that it lives.
        owner
            .send_to(&questions(5, SESSION, 30), victim.at.udp)
            .unwrap();
        while owner.recv(&mut [0; 2000]).is_ok() {}
    }
    let stats = victim.shows()["stats"].clone();
    let (taken, refused) = (&stats["takeovers"], &stats["takeovers_refused"]);
    println!("takeovers: {taken}, {refused} refused");
    assert_eq!(taken, 0);
    assert!(refused.as_u64().unwrap() > 10);
}

/// A topic that is refused is in the log and in the JSON, with its client and in ROS's names.
#[test]
fn a_refused_topic_is_in_the_log_and_in_the_json() {
    let scratch = Scratch::new("refusals");
    let mut victim = Victim::with(&scratch, "n", &["--entities=2".into()]);
    let mut raw = Raw::open(victim.at.tcp, 0x0501_0203, 512);
    raw.topic(1, "rt/a");
    raw.topic(2, "rt/chatter");
    let line = victim
        .running
        .expect_line("/chatter (T): refused", super::SOON);
    assert!(line.contains("client 05010203 at tcp 127.0.0.1:"), "{line}");
    assert!(line.ends_with("RESOURCES: limits.entities = 2"), "{line}");
    let state = victim.shows();
    let mut rows = state["refusals"].as_array().unwrap().iter();
    let row = rows.rfind(|row| row["topic"] == "/chatter").unwrap();
    assert_eq!(
        (&row["client"], &row["type"]),
        (&"05010203".into(), &"T".into())
    );
    assert!(
        row["reason"]
            .as_str()
            .unwrap()
            .ends_with("limits.entities = 2")
    );
}
