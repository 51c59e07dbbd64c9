//! `zerodds-xrce-client`, a client written from the specification by others, against our agent:
//! publish and subscribe, reliable and best effort, with itself and with our client.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]

mod ours;
mod theirs;

use ours::Ours;
use replenish_agent::{Agent, AgentConfig, RunningAgent};
use std::net::Ipv4Addr;
use std::time::{Duration, Instant};
use theirs::Theirs;

const SAMPLES: u32 = 200;

fn agent() -> RunningAgent {
    let config = AgentConfig {
        addr: (Ipv4Addr::LOCALHOST, 0).into(),
        ..AgentConfig::default()
    };
    Agent::bind(&config).unwrap().spawn().unwrap()
}

fn sample(number: u32) -> Vec<u8> {
    number.to_le_bytes().repeat(1 + number as usize % 30)
}

/// Until `done`, which must be soon.
fn until(what: &str, mut turn: impl FnMut() -> bool) {
    let end = Instant::now() + Duration::from_secs(20);
    while !turn() {
        assert!(Instant::now() < end, "in vain: {what}");
        std::thread::sleep(Duration::from_micros(200));
    }
}

/// Everything in order; best effort on a loopback that is not overrun loses nothing either.
fn assert_all(got: &[Vec<u8>]) {
    let expected: Vec<Vec<u8>> = (0..SAMPLES).map(sample).collect();
    assert_eq!(got.len(), expected.len());
    assert_eq!(got, expected);
}

fn theirs_to_theirs(reliable: bool) {
    let agent = agent();
    let mut writer = Theirs::connect(agent.local_addr(), 1);
    let mut reader = Theirs::connect(agent.local_addr(), 2);
    writer.writes("loop");
    reader.reads("loop", reliable);
    for number in 0..SAMPLES {
        writer.write(&sample(number), reliable);
        until("the sample", || {
            writer.turn();
            reader.turn();
            reader.got.len() > number as usize
        });
    }
    assert_all(&reader.got);
    writer.disconnect();
    reader.disconnect();
    until("the sessions end", || agent.stats().clients == 0);
    let stats = agent.stop().unwrap();
    assert_eq!(
        (stats.malformed, stats.unsupported, stats.refused),
        (0, 0, 0),
        "{stats:?}"
    );
}

#[test]
fn reliable() {
    theirs_to_theirs(true);
}

#[test]
fn best_effort() {
    theirs_to_theirs(false);
}

/// The correction in `Theirs` is needed: without it the first sample is the only one.
#[test]
fn best_effort_as_they_number_it() {
    let agent = agent();
    let mut client = Theirs::numbering(agent.local_addr(), 1, false);
    client.writes("loop");
    client.reads("loop", false);
    for number in 0..5 {
        client.write(&sample(number), false);
    }
    // A reliable sample comes after the first one, and gets through.
    client.write(b"last", true);
    until("the last sample", || {
        client.turn();
        client.got.contains(&b"last".to_vec())
    });
    assert_eq!(client.got, [sample(0), b"last".to_vec()]);
}

/// Both implementations at one agent, both directions at once.
fn together(reliable: bool) {
    let agent = agent();
    let mut theirs = Theirs::connect(agent.local_addr(), 1);
    let mut ours = Ours::connect(agent.local_addr(), 2, "to_them", "to_us", reliable);
    theirs.writes("to_us");
    theirs.reads("to_them", reliable);
    until("we are up", || {
        ours.turn();
        ours.is_up()
    });
    for number in 0..SAMPLES {
        theirs.write(&sample(number), reliable);
        ours.write(&sample(number), reliable);
        until("the samples", || {
            theirs.turn();
            ours.turn();
            ours.got.len() > number as usize && theirs.got.len() > number as usize
        });
    }
    assert_all(&ours.got);
    assert_all(&theirs.got);
}

#[test]
fn with_our_client_reliable() {
    together(true);
}

#[test]
fn with_our_client_best_effort() {
    together(false);
}

/// In fragments, to the agent and back from it.
#[test]
fn a_large_sample() {
    let agent = agent();
    let mut client = Theirs::connect(agent.local_addr(), 1);
    client.writes("large");
    client.reads("large", true);
    let large: Vec<u8> = (0..6000_u32).map(|i| (i % 251) as u8).collect();
    client.write(&large, true);
    until("the sample", || {
        client.turn();
        !client.got.is_empty()
    });
    assert_eq!(client.got, [large]);
}

/// Many at once, without waiting for each other: nothing is lost, nothing comes twice.
#[test]
fn a_burst() {
    let agent = agent();
    let mut writer = Theirs::connect(agent.local_addr(), 1);
    let mut reader = Theirs::connect(agent.local_addr(), 2);
    writer.writes("burst");
    reader.reads("burst", true);
    for number in 0..SAMPLES {
        writer.write(&sample(number), true);
        if number % 8 == 7 {
            until("the sample", || {
                writer.turn();
                reader.turn();
                reader.got.len() > number as usize
            });
        }
    }
    assert_all(&reader.got);
}
