//! Random inputs by the million: damaged captures, splices of them, and noise. No panic, no growth,
//! and after each share of them agent and client serve as if nothing had been.
//!
//! 200 000 inputs by default; `REPLENISH_INPUTS=10000000` for as many as you like, with `--release`
//! and `--nocapture` for the figures. `REPLENISH_SEED` chooses others.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]

#[path = "../../replenish-xrce/tests/it/common/mod.rs"]
mod common;
mod fuzzed;

use fuzzed::{Script, cdr, datagram, decoders, text};
use fuzzed::{agent::Agent, agent::login, client::Client};
use replenish_testkit::alloc::CountingAllocator;
use replenish_xrce::framing::{serial_frame, serial_frame_len};
use replenish_xrce::wire::Message;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::time::Instant;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator::new();

/// Shares after each of which everything must be as at the beginning.
const SHARES: u64 = 20;

/// Memory that all clients together may hold: the limits of the agent, and the fixed memory of all.
const MOST: usize = 4 << 20;

/// xorshift64*.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }
}

/// The captured messages of one direction, by their kind.
struct Corpus(Vec<Vec<Vec<u8>>>);

impl Corpus {
    fn new(from_clients: bool) -> Self {
        let mut kinds = BTreeMap::<u8, Vec<Vec<u8>>>::new();
        for datagram in common::capture() {
            if datagram.from_client == from_clients {
                let at = Message::parse(&datagram.bytes)
                    .unwrap()
                    .header
                    .session
                    .header_len();
                kinds
                    .entry(datagram.bytes[at])
                    .or_default()
                    .push(datagram.bytes);
            }
        }
        if from_clients {
            let logins = (0..4).flat_map(|i| [login(i, 0x81), login(i, 0x01)]);
            kinds.entry(0).or_default().extend(logins);
        } else {
            // Samples for the readers that the session under fire has, whatever their requests are.
            for request in 10..40 {
                let base = [request, 0, 0x16];
                for stream in [0x01, 0x80, 0x81] {
                    let data = [&[0x81, stream, 0, 0, 9, 1, 8, 0, 0], &base[..], b"data"].concat();
                    kinds.entry(9).or_default().push(data);
                }
            }
        }
        // Log-outs and log-ins are rarer than what happens between them.
        let often = |kind: u8| match kind {
            3 => 1,
            0 => 4,
            _ => 16,
        };
        let lists = kinds.into_iter();
        let weighted = lists.flat_map(|(kind, list)| std::iter::repeat_n(list, often(kind)));
        Self(weighted.collect())
    }

    /// One of any kind.
    fn draw(&self, random: &mut Random) -> &[u8] {
        let list = &self.0[random.below(self.0.len())];
        &list[random.below(list.len())]
    }
}

/// Damages what is there: nothing, some bytes, an end, a middle; or something else altogether.
fn damage(bytes: &[u8], other: &[u8], random: &mut Random, out: &mut Vec<u8>) {
    out.clear();
    match random.below(16) {
        0..5 => out.extend(bytes),
        5..10 => {
            out.extend(bytes);
            for _ in 0..=random.below(4) {
                let at = random.below(out.len());
                out[at] = match random.below(3) {
                    0 => random.next() as u8,
                    1 => out[at] ^ (1 << random.below(8)),
                    _ => [0, 1, 0x7f, 0x80, 0xff][random.below(5)],
                };
            }
        }
        10 | 11 => out.extend(&bytes[..random.below(bytes.len() + 1)]),
        12 | 13 => {
            out.extend(&bytes[..random.below(bytes.len() + 1)]);
            out.extend(&other[random.below(other.len() + 1)..]);
        }
        14 => {
            out.extend(bytes);
            let at = random.below(out.len() + 1);
            let more: Vec<u8> = (0..random.below(9)).map(|_| random.next() as u8).collect();
            out.splice(at..at, more);
        }
        _ => out.extend((0..random.below(80)).map(|_| random.next() as u8)),
    }
}

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().expect("a number"))
}

#[test]
fn millions_of_inputs() {
    let (inputs, seed) = (
        number("REPLENISH_INPUTS", 200_000),
        number("REPLENISH_SEED", 1),
    );
    let (from_clients, from_agents) = (Corpus::new(true), Corpus::new(false));
    let started = Instant::now();
    let mut random = Random(0x9e37_79b9_7f4a_7c15 ^ (seed << 32));
    let (mut agent, mut bytes, mut step) = (Agent::new(), Vec::new(), Vec::new());
    let before = ALLOCATOR.live();
    let (mut peak, mut after, mut samples) = (0, Vec::with_capacity(64), 0);
    for share in 0..SHARES {
        let mut client = Client::new();
        for i in 0..inputs / SHARES {
            let to_agent = random.below(2) == 0;
            let corpus = if to_agent {
                &from_clients
            } else {
                &from_agents
            };
            let (one, other) = (corpus.draw(&mut random), corpus.draw(&mut random));
            damage(one, other, &mut random, &mut bytes);
            decoders::message(&bytes);
            step.clear();
            if random.below(8) == 0 {
                // Time passes, or the application or the link does something.
                let most = if to_agent { 64 } else { 256 };
                step.extend([random.next() as u8 | 0x10, random.below(most) as u8]);
            } else {
                let op = random.below(16) as u8;
                step = datagram(if to_agent { op } else { op % 3 }, &bytes);
            }
            if to_agent {
                agent.step(&mut Script(&step));
            } else {
                client.step(&mut Script(&step));
            }
            match i % 16 {
                0 => decoders::framing(&bytes, random.below(20)),
                1 => cdr::every_type(&bytes),
                2 if i % 256 == 2 => text::everywhere(&String::from_utf8_lossy(&bytes)),
                _ => {}
            }
            peak = peak.max(ALLOCATOR.live() - before);
        }
        assert!(peak < MOST, "{peak} bytes in share {share}");
        client.end();
        agent.end();
        samples += client.samples;
        drop(client);
        after.push(ALLOCATOR.live() - before);
    }
    println!(
        "{inputs} inputs in {:.1} s, at most {peak} bytes; after each share {after:?}; \
         {samples} samples reached the client, agent: {:?}",
        started.elapsed().as_secs_f64(),
        agent.stats()
    );
    // Capacities that the first shares left allocated are all that is ever left allocated.
    let (early, late) = after.split_at(after.len() / 2);
    let (early, late) = (early.iter().max().unwrap(), late.iter().max().unwrap());
    assert!(*late <= early + 4096, "{after:?}");
    let stats = agent.stats();
    assert!(samples > 0, "the client gets samples");
    assert!(
        stats.samples_out > 0 && stats.clients_created > 0,
        "{stats:?}"
    );
}

/// Writes what the fuzz targets begin with: `cargo test -p replenish-agent --test inputs --
/// --ignored`.
#[test]
#[ignore = "writes fuzz/corpus"]
fn seeds() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus");
    let write = |target: &str, name: String, bytes: &[u8]| {
        let folder = corpus.join(target);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join(format!("seed-{name}")), bytes).unwrap();
    };
    let mut kinds = BTreeSet::new();
    let mut scripts = BTreeMap::<String, (Vec<u8>, Vec<u8>, Vec<u16>, u64)>::new();
    for datagram in common::capture() {
        let bytes = &datagram.bytes;
        let at = Message::parse(bytes).unwrap().header.session.header_len();
        if kinds.insert((datagram.from_client, bytes[at], bytes.len() > 60)) {
            let name = format!(
                "{}-{}",
                datagram.scenario.replace(' ', "_"),
                datagram.number
            );
            write("message", name.clone(), bytes);
            let mut frame = vec![0; serial_frame_len(bytes.len())];
            let len = serial_frame(1, 0, bytes, &mut frame).unwrap();
            write("framing", name, &[&[7], &frame[..len]].concat());
        }
        let script = scripts.entry(datagram.scenario.clone()).or_default();
        let (agent, client, ports, last) = script;
        let port = datagram.client_port;
        let peer = ports.iter().position(|p| *p == port).unwrap_or_else(|| {
            ports.push(port);
            ports.len() - 1
        });
        let passed = (datagram.time.saturating_sub(*last) / fuzzed::MS).min(255) as u8;
        *last = datagram.time;
        if datagram.from_client && agent.len() < 3000 {
            agent.extend([4 * 4, passed]);
            agent.extend(fuzzed::datagram(4 + (peer % 4) as u8, bytes));
        } else if !datagram.from_client && client.len() < 3000 {
            client.extend([4, passed, 3]);
            client.extend(fuzzed::datagram(1, bytes));
            client.extend([6 + 8 * (bytes.len() % 10) as u8, passed]);
        }
    }
    for (number, (agent, client, ..)) in scripts.values().enumerate() {
        write("agent", number.to_string(), agent);
        write("client", number.to_string(), client);
    }
    for (number, text) in [
        "<dds><data_writer><topic><kind>NO_KEY</kind><name>T</name><dataType>T</dataType></topic></data_writer></dds>",
        "<dds><requester profile_name=\"r\"service_name=\"s\"request_type='Q' reply_type=\"R\"></requester></dds>",
        "<profiles><topic profile_name=\"t\"><name>T</name><dataType>T</dataType></topic></profiles>",
    ]
    .iter()
    .enumerate()
    {
        write("text", number.to_string(), text.as_bytes());
    }
    write(
        "cdr",
        "text".into(),
        b"\x05\0\0\0four\0\0\0\0\x01\0\0\0\x02\0\0\0\x02\0\0\0a\0\0\0",
    );
}
