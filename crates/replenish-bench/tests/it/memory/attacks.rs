//! Ten ways to make an agent take memory.

use crate::attacker::{Raw, SESSION, host, log_in, message, questions, send};
use replenish_xrce::wire::{
    EndpointQos, ObjectKind, QOS_DURABILITY_TRANSIENT_LOCAL, QOS_RELIABLE, StreamId,
};
use std::net::SocketAddr;
use std::time::{Duration, Instant};

/// Places for clients.
pub(crate) const CLIENTS: u32 = 16;

/// The longest sample.
pub(crate) const SAMPLE: usize = 30_000;

/// Addresses of an agent.
#[derive(Clone, Copy)]
pub(crate) struct Target {
    pub(crate) udp: SocketAddr,
    pub(crate) tcp: SocketAddr,
}

/// An attack; it gives what must stay open until the memory was read.
pub(crate) type Attack = fn(Target) -> Vec<Raw>;

pub(crate) const ATTACKS: [(&str, Attack); 10] = [
    ("full reliable queues", full_queues),
    ("names of maximal length on all clients", long_names),
    ("TCP connections that never log in", no_log_in),
    ("fragments that never end", fragments),
    ("readers that never read", unread),
    ("log-in floods from many addresses", log_ins),
    ("takeovers", takeovers),
    ("create and delete churn", churn),
    ("oversize samples", oversize),
    ("info requests", infos),
];

/// Keep-all, reliable.
fn keep_all() -> EndpointQos<'static> {
    EndpointQos {
        flags: QOS_RELIABLE,
        ..EndpointQos::default()
    }
}

/// The same, kept for readers that come later.
fn durable() -> EndpointQos<'static> {
    EndpointQos {
        flags: QOS_RELIABLE | QOS_DURABILITY_TRANSIENT_LOCAL,
        ..EndpointQos::default()
    }
}

/// Every client keeps as much as it may: samples without a byte in them, which cost most, long
/// ones, and histories.
fn full_queues(at: Target) -> Vec<Raw> {
    let mut all = Vec::new();
    for key in 1..=CLIENTS {
        let mut raw = Raw::open(at.tcp, key, 512);
        raw.topic(1, &format!("full{key}"));
        match key % 4 {
            0 => raw.writer(1, 1, durable()),
            _ => raw.writer(1, 1, keep_all()),
        }
        let readers = u16::from(key % 4 != 0); // more would share what they are charged with
        for number in 1..=readers {
            raw.reader(number, 1, keep_all());
        }
        match key % 4 {
            0 => (0..10).for_each(|_| assert!(raw.write_many(1, 0))),
            1 => (0..400).for_each(|_| assert!(raw.write(1, SAMPLE))),
            2 => (0..3).for_each(|_| assert!(raw.write_many(1, 0))),
            _ => (0..20).for_each(|_| assert!(raw.write_many(1, 100))),
        }
        all.push(raw);
    }
    all
}

/// Every client has as many requesters as it may, with four names each.
pub(crate) fn long_names(at: Target) -> Vec<Raw> {
    let mut all = Vec::new();
    for key in 1..=CLIENTS {
        let mut raw = Raw::open(at.tcp, key, 512);
        (1..=600).for_each(|number| raw.requester(number));
        all.push(raw);
    }
    all
}

/// Connections that begin the longest message and never end it, and more than there is room for.
fn no_log_in(at: Target) -> Vec<Raw> {
    let mut all = Vec::new();
    for key in 1..=4 * CLIENTS {
        let mut raw = Raw::connect(at.tcp, key);
        raw.bytes(&[0xff, 0xff]);
        raw.bytes(&vec![7; 65_534]);
        all.push(raw);
    }
    all
}

/// Samples in fragments without a last one, and messages that come before an earlier one, on all
/// streams that a client may have and more.
fn fragments(at: Target) -> Vec<Raw> {
    let mut all = Vec::new();
    for key in 1..=CLIENTS {
        let mut raw = Raw::open(at.tcp, key, u16::MAX);
        for stream in 0x80..0x90 {
            for seq in (0..40).chain(100..140) {
                let piece = vec![5; 2000];
                let len = u16::try_from(piece.len()).unwrap().to_le_bytes();
                let body = [&[13, 1], &len[..], &piece].concat();
                let head = message((key, SESSION), (StreamId(stream), seq), |_| ());
                raw.frame(&[head, body].concat());
            }
        }
        all.push(raw);
    }
    all
}

/// Subscribers on connections that they do not read, while others write, and ask.
fn unread(at: Target) -> Vec<Raw> {
    let readers = (1..CLIENTS).map(|key| Raw::open(at.tcp, key, u16::MAX));
    starve(Raw::open(at.tcp, 100, 512), readers)
}

/// `talker` writes for `readers`, which ask for everything and read next to nothing.
pub(crate) fn starve(mut talker: Raw, readers: impl Iterator<Item = Raw>) -> Vec<Raw> {
    talker.topic(1, "unread");
    talker.writer(1, 1, EndpointQos::default());
    let mut all = Vec::new();
    for mut raw in readers {
        raw.reads = false;
        raw.topic(1, "unread");
        for number in 1..=20 {
            raw.reader(number, 1, EndpointQos::default());
            let streams = [StreamId::RELIABLE, StreamId::BEST_EFFORT];
            raw.read(number, streams[usize::from(number % 2)]);
        }
        all.push(raw);
    }
    for _ in 0..300 {
        talker.write(1, SAMPLE);
    }
    for raw in &mut all {
        let ask = questions(raw.key, SESSION, 4000);
        for _ in 0..50 {
            raw.frame(&ask);
            // It reads a little now and then, so that nothing ever gets empty.
            std::io::Read::read(&mut raw.stream, &mut [0; 100]).ok();
        }
    }
    all.push(talker);
    all
}

/// Log-ins with ever new keys from two hundred hosts, over UDP and TCP.
fn log_ins(at: Target) -> Vec<Raw> {
    let hosts: Vec<_> = (1..=200).map(host).collect();
    let end = Instant::now() + Duration::from_secs(2);
    let mut key = 1000;
    while Instant::now() < end {
        for socket in &hosts {
            key += 1;
            send(socket, at.udp, &log_in(key, 512));
        }
    }
    let connections = (0..2 * CLIENTS).map(|n| Raw::open(at.tcp, key + n, u16::MAX));
    connections.collect()
}

/// Log-ins with the keys of others from everywhere.
fn takeovers(at: Target) -> Vec<Raw> {
    let all: Vec<Raw> = (1..=CLIENTS)
        .map(|key| Raw::open(at.tcp, key, 512))
        .collect();
    let hosts: Vec<_> = (1..=100).map(host).collect();
    let end = Instant::now() + Duration::from_secs(2);
    while Instant::now() < end {
        for (number, socket) in (1..).zip(&hosts) {
            send(socket, at.udp, &log_in(1 + number % CLIENTS, 512));
        }
    }
    all
}

/// Queues and tables that are filled and deleted, one after another, so that each leaves what it
/// can.
fn churn(at: Target) -> Vec<Raw> {
    let mut all = Vec::new();
    for key in 1..=CLIENTS {
        let mut raw = Raw::open(at.tcp, key, 512);
        for round in 0..6 {
            for topic in 1..=4 {
                raw.topic(topic, &format!("churn{key}-{round}-{topic}"));
                raw.writer(topic, topic, durable());
                (1..=40).for_each(|number| raw.reader(topic * 50 + number, topic, keep_all()));
                raw.write_many(topic, [0, 500, 3000][usize::from(topic) % 3]);
                // All but one.
                for number in 2..=40 {
                    raw.delete(topic * 50 + number, ObjectKind::DataReader);
                }
                (1..=60).for_each(|number| raw.requester(number));
                (1..=60).for_each(|number| raw.delete(number, ObjectKind::Requester));
            }
        }
        all.push(raw);
    }
    all
}

/// Samples that are longer than they may be, in one message, and in fragments.
fn oversize(at: Target) -> Vec<Raw> {
    let mut all = Vec::new();
    for key in 1..=CLIENTS {
        let mut raw = Raw::open(at.tcp, key, 8192);
        raw.topic(1, "oversize");
        raw.writer(1, 1, durable());
        raw.reader(1, 1, keep_all());
        for _ in 0..20 {
            raw.write(1, 65_000);
        }
        for seq in 0..60 {
            let piece = vec![5; 8000];
            let len = u16::try_from(piece.len()).unwrap().to_le_bytes();
            let last = if seq % 20 == 19 { 3 } else { 1 };
            let body = [&[13, last], &len[..], &piece].concat();
            let head = message((key, SESSION), (StreamId::RELIABLE, seq), |_| ());
            raw.frame(&[head, body].concat());
        }
        all.push(raw);
    }
    all
}

/// Questions, as many as a message takes, in sessions and outside.
fn infos(at: Target) -> Vec<Raw> {
    let mut all: Vec<Raw> = (1..=CLIENTS)
        .map(|key| Raw::open(at.tcp, key, 512))
        .collect();
    for raw in &mut all {
        raw.reads = raw.key % 2 == 0;
        let ask = questions(raw.key, SESSION, 60_000);
        (0..20).for_each(|_| _ = raw.frame(&ask));
    }
    let hosts: Vec<_> = (1..=50).map(host).collect();
    for _ in 0..20 {
        for (key, socket) in (1..).zip(&hosts) {
            send(
                socket,
                at.udp,
                &questions(key, SESSION.before_login(), 1400),
            );
        }
    }
    all
}
