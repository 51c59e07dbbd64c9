//! A2, A3, A16, A18: samples that were acknowledged and never came, and readers that do not read.

use super::{agent, row};
use crate::attacker::{Raw, SESSION, questions};
use crate::common::Scratch;
use crate::memory::Victim;
use crate::stock_client::{At, HISTORY, KEEP_ALL, KEEP_TEN, Stock, bursts};
use replenish_testkit::harness::{Trial, trial};
use replenish_xrce::wire::{EndpointQos, StreamId};
use std::net::UdpSocket;
use std::time::{Duration, Instant};

const RELIABLE: StreamId = StreamId::RELIABLE;

/// A writer and a reader of a topic, reliable and keep-all.
fn pair(at: At, topic: &str) -> (Stock, Stock) {
    let (mut talker, mut listener) = (Stock::new(at, 201), Stock::new(at, 202));
    talker.equip((topic, "T"), KEEP_ALL, None);
    listener.equip((topic, "T"), KEEP_ALL, Some(KEEP_ALL));
    listener.read(RELIABLE);
    (talker, listener)
}

/// Writes `samples` samples, until nothing comes any more. Returns the numbers that were
/// acknowledged, and that arrived.
fn exchange(talker: &mut Stock, listener: &mut Stock, samples: usize) -> (usize, usize) {
    finish(talker, listener, 0, samples)
}

/// The same, of which some are `written`.
fn finish(
    talker: &mut Stock,
    listener: &mut Stock,
    mut written: usize,
    samples: usize,
) -> (usize, usize) {
    let (mut arrived, mut last) = (0, Instant::now());
    while last.elapsed() < Duration::from_secs(2) && (arrived < samples || talker.under_way() > 0) {
        if written < samples && talker.under_way() < HISTORY {
            talker.write(RELIABLE, &[7; 100]);
            written += 1;
            last = Instant::now();
        }
        talker.turn();
        listener.turn();
        let came = std::mem::take(&mut listener.got).len();
        arrived += came;
        if came > 0 {
            last = Instant::now();
        }
    }
    (written - talker.under_way(), arrived)
}

/// b209253 had one pool of 64 MiB for the samples of all clients.
fn a02_ten_strangers_fill_the_memory_for_samples() {
    let scratch = Scratch::new("a02");
    let victim = agent(&scratch, &[]);
    let (mut talker, mut listener) = pair(At::Udp(victim.at.udp), "honest");
    let before = exchange(&mut talker, &mut listener, 20);
    assert_eq!(before, (20, 20), "control");
    let mut strangers = Vec::new();
    for key in 1..=10 {
        let mut raw = Raw::open(victim.at.tcp, key, 512);
        raw.topic(1, &format!("full{key}"));
        raw.writer(1, 1, KEEP_ALL);
        raw.reader(1, 1, KEEP_ALL);
        // Up to the last byte, too.
        (0..260).for_each(|_| assert!(raw.write(1, 30_000)));
        (0..200).for_each(|_| assert!(raw.write(1, 100)));
        strangers.push(raw);
    }
    victim.shows(); // all of it was handled
    let (acknowledged, arrived) = exchange(&mut talker, &mut listener, 20);
    let figure = format!("{acknowledged} of 20 acknowledged, {arrived} arrived");
    let holds = (acknowledged, arrived) == (20, 20);
    row("A2", "10 strangers fill the memory", &figure, holds);
}

/// b209253 acknowledged and dropped, after a second.
fn a03_a_reliable_keep_all_reader_stands_still() {
    const SAMPLES: usize = 1000;
    let scratch = Scratch::new("a03");
    let victim = agent(&scratch, &[]);
    let (mut talker, mut listener) = pair(At::Udp(victim.at.udp), "still");
    let before = exchange(&mut talker, &mut listener, 20);
    assert_eq!(before, (20, 20), "control");
    let (mut written, begin) = (0, Instant::now());
    while begin.elapsed() < Duration::from_secs(3) {
        if written < SAMPLES && talker.under_way() < HISTORY {
            talker.write(RELIABLE, &[7; 100]);
            written += 1;
        }
        talker.turn();
    }
    let (acknowledged, arrived) = finish(&mut talker, &mut listener, written, SAMPLES);
    let figure = format!("{acknowledged} of {SAMPLES} acknowledged, {arrived} arrived");
    let holds = (acknowledged, arrived) == (SAMPLES, SAMPLES);
    row("A3", "the reader stands still for 3 s", &figure, holds);
}

/// Nanoseconds of CPU time that the agent's thread has used.
fn cpu_time(victim: &Victim) -> u64 {
    let tasks = std::fs::read_dir(format!("/proc/{}/task", victim.running.id())).unwrap();
    let task = tasks.map(|task| task.unwrap().path()).find(|task| {
        std::fs::read_to_string(task.join("comm")).is_ok_and(|name| name.trim() == "xrce-agent")
    });
    let stat = std::fs::read_to_string(task.unwrap().join("schedstat")).unwrap();
    stat.split(' ').next().unwrap().parse().unwrap()
}

/// The agent's CPU time for a ping and a sample of others, in ns: the least of ten stretches. A
/// hypervisor that has the CPU, and interrupts, can only add to one.
fn cost(victim: &Victim, noise: &mut Raw) -> f64 {
    const ROUNDS: u32 = 100;
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(victim.at.udp).unwrap();
    socket.set_read_timeout(Some(super::SOON)).unwrap();
    let ping = questions(9, SESSION.before_login(), 24);
    let stretch = || {
        let begin = cpu_time(victim);
        for _ in 0..ROUNDS {
            assert!(noise.write(1, 400));
            socket.send(&ping).unwrap();
            socket.recv(&mut [0; 200]).unwrap();
        }
        cpu_time(victim) - begin
    };
    let least = std::iter::repeat_with(stretch).take(10).min().unwrap();
    least as f64 / f64::from(ROUNDS)
}

/// b209253 looked for the clients of every connection that takes nothing, at every datagram. A
/// ratio of the agent's CPU times in one run.
fn a16_tcp_readers_that_do_not_read() {
    const STUCK: u32 = 180;
    let scratch = Scratch::new("a16");
    let victim = agent(&scratch, &["--clients=240", "--strangers-rate=0"]);
    let mut noise = Raw::open(victim.at.tcp, 1000, 512);
    noise.topic(1, "none");
    noise.writer(1, 1, EndpointQos::default());
    cost(&victim, &mut noise);
    let alone = cost(&victim, &mut noise);
    let mut flood = Raw::open(victim.at.tcp, 1001, 512);
    flood.patience = super::SOON;
    flood.topic(1, "flood");
    flood.writer(1, 1, EndpointQos::default());
    let mut stuck = Vec::new();
    for key in 1..=STUCK {
        let mut raw = Raw::open(victim.at.tcp, key, u16::MAX);
        raw.reads = false;
        raw.topic(1, "flood");
        raw.reader(1, 1, EndpointQos::default());
        raw.read(1, StreamId::BEST_EFFORT);
        stuck.push(raw);
    }
    let sent = |state: &serde_json::Value| state["stats"]["samples_out"].as_u64().unwrap();
    let mut before = sent(&victim.shows());
    loop {
        for number in 0..400 {
            assert!(flood.write(1, 7900), "control");
            if number % 10 == 0 {
                std::thread::sleep(Duration::from_millis(5));
            }
        }
        let now = sent(&victim.shows());
        if now < before + 400 {
            break; // each has taken four more at most
        }
        before = now;
    }
    let beside = cost(&victim, &mut noise);
    let ratio = beside / alone;
    let figure = format!("a datagram takes {ratio:.2} times the agent's CPU time");
    // The kernel looks at 180 more descriptors; b209253 looked at 180 clients for each of them.
    row("A16", "180 TCP readers do not read", &figure, ratio < 8.0);
}

/// b209253 took a burst as a whole before it sent anything.
fn a18_a_stock_client_writes_bursts_of_forty_over_tcp() {
    const SAMPLES: usize = 1000;
    let scratch = Scratch::new("a18");
    let victim = agent(&scratch, &[]);
    let (mut talker, mut listener) = (
        Stock::new(At::Tcp(victim.at.tcp), 201),
        Stock::new(At::Tcp(victim.at.tcp), 202),
    );
    talker.equip(("c", "T"), KEEP_TEN, None);
    listener.equip(("c", "T"), KEEP_TEN, Some(KEEP_TEN));
    listener.read(RELIABLE);
    let before = exchange(&mut talker, &mut listener, 20);
    assert_eq!(before, (20, 20), "control");
    let quiet = Duration::from_secs(2);
    let counts = [(1, RELIABLE), (3, StreamId::BEST_EFFORT)]
        .map(|(key, stream)| bursts(At::Tcp(victim.at.tcp), key, stream, SAMPLES, quiet).0);
    let [reliable, loose] = counts;
    let figure = format!("of {SAMPLES} arrive {reliable} reliable, {loose} best-effort");
    let holds = counts == [SAMPLES; 2];
    row(
        "A18",
        "bursts of 40 over TCP, the reader keeps 10",
        &figure,
        holds,
    );
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial(
            "a02_ten_strangers_fill_the_memory_for_samples",
            a02_ten_strangers_fill_the_memory_for_samples,
        ),
        trial(
            "a03_a_reliable_keep_all_reader_stands_still",
            a03_a_reliable_keep_all_reader_stands_still,
        ),
        trial(
            "a16_tcp_readers_that_do_not_read",
            a16_tcp_readers_that_do_not_read,
        ),
        trial(
            "a18_a_stock_client_writes_bursts_of_forty_over_tcp",
            a18_a_stock_client_writes_bursts_of_forty_over_tcp,
        ),
    ]
}
