//! Structured traffic of strangers by the million, some of it damaged: every decoder, and a whole
//! participant beside an honest peer. No panic, no allocation after set-up; the honest peer's
//! samples come once and in order, and after each share all is as at the beginning.
//!
//! 100 000 datagrams by default; `REPLENISH_INPUTS=10000000` for as many as you like, with
//! `--release` and `--nocapture` for the figures. `REPLENISH_SEED` chooses others.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]

mod fuzzed;

use fuzzed::datagrams::{Traffic, goodbye};
use fuzzed::node::{FIRED_AT, Pair};
use fuzzed::{Choice, Random, decoders};
use replenish_rtps::participant::{EndpointSpec, Participant, ParticipantConfig};
use replenish_rtps::ros::KnownNodes;
use replenish_rtps::wire::{GuidPrefix, Locators};
use replenish_testkit::alloc::CountingAllocator;
use std::net::SocketAddr;
use std::sync::Mutex;
use std::time::Instant;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator::new();

/// Held by each test: the allocator counts for all.
static TURN: Mutex<()> = Mutex::new(());

/// After each of them all strangers are gone.
const SHARES: u64 = 20;
/// Datagrams between two samples of the honest peer.
const HONEST: u64 = 16;
const MS: u64 = 1_000_000;

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().expect("a number"))
}

#[test]
fn millions_of_inputs() {
    let _turn = TURN.lock().expect("no other test panicked");
    let (inputs, seed) = (
        number("REPLENISH_INPUTS", 100_000),
        number("REPLENISH_SEED", 1),
    );
    let started = Instant::now();
    let mut random = Random(0x9e37_79b9_7f4a_7c15 ^ (seed << 32));
    let mut pair = Pair::new();
    let (writer, readers) = pair.names();
    let mut traffic = Traffic::new(FIRED_AT, writer, readers);
    let (mut buf, mut bytes) = ([0; 4096], 0);
    let (mut known, mut most) = (KnownNodes::new(decoders::NODES), 0);
    let mut after = Vec::with_capacity(64);
    for _ in 0..SHARES {
        ALLOCATOR.arm();
        for i in 0..inputs / SHARES {
            let len = traffic.datagram(&mut random, &mut buf);
            bytes += len;
            decoders::datagram(&buf[..len], &mut known);
            most = most.max(known.names().count());
            pair.receive(&buf[..len]);
            if random.one_in(8) {
                let longest = if random.one_in(500) { 2000 } else { 10 };
                pair.pass(random.below(longest) as u64 * MS);
            }
            if i % HONEST == 0 {
                ALLOCATOR.disarm();
                pair.honest();
                ALLOCATOR.arm();
            }
        }
        assert_eq!(ALLOCATOR.disarm(), 0, "allocations after set-up");
        pair.strangers_go(goodbye);
        after.push(ALLOCATOR.live());
    }
    let [samples, graphs, events, matches] = pair.counts;
    assert_eq!(after, [after[0]; SHARES as usize], "bytes are left");
    println!(
        "{inputs} datagrams of {bytes} bytes in {:.1} s, no allocation, {} bytes in all; strangers: \
         {samples} samples, {graphs} messages about nodes, {events} events, {matches} matches",
        started.elapsed().as_secs_f64(),
        ALLOCATOR.live(),
    );
    // The traffic reaches everything.
    let least = |count| count > inputs / 1000;
    assert!(least(samples) && least(events) && least(matches));
    assert!(graphs > 0 && most == decoders::NODES.nodes);
}

/// From one address to four, and back to one.
#[test]
fn a_move_takes_no_memory() {
    let _turn = TURN.lock().expect("no other test panicked");
    let there = |ips: &[[u8; 4]], port| -> Locators {
        ips.iter().map(|ip| SocketAddr::from((*ip, port))).collect()
    };
    let (one, four) = ([[10, 0, 0, 1]], [2, 3, 4, 5].map(|last| [10, 0, 0, last]));
    let config = ParticipantConfig {
        discovery: there(&one, 7410),
        user: there(&one, 7411),
        ..ParticipantConfig::new(GuidPrefix([7; 12]))
    };
    let mut node = Participant::new(&config, 0).unwrap();
    node.expect_moves();
    let long = "n".repeat(255);
    for _ in 0..8 {
        let reader = EndpointSpec {
            unicast: there(&one, 40_000),
            ..EndpointSpec::new(&long, &long)
        };
        node.create_reader(&reader, 0).unwrap();
        node.create_writer(&EndpointSpec::new(&long, &long), 0)
            .unwrap();
    }
    // The harness may start its next test meanwhile, and counts as well.
    let mut at = 0;
    let counts = [(); 3].map(|()| {
        ALLOCATOR.arm();
        for ips in [&four[..], &one[..], &four[..]] {
            at += 1;
            node.move_to(&there(ips, 0), at);
            while node.announce_moved(at) {}
        }
        ALLOCATOR.disarm()
    });
    assert!(counts.contains(&0), "{counts:?}");
}
