//! `zerodds-xrce-agentd` with our client, by hand: its build takes minutes, and it needs a
//! configuration. Where it listens is in `REPLENISH_PEER_AGENT`; docs/peers.md has the results.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]

mod ours;

use ours::Ours;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

fn echo(key: u8, reliable: bool) {
    let agent: SocketAddr = std::env::var("REPLENISH_PEER_AGENT")
        .expect("REPLENISH_PEER_AGENT")
        .parse()
        .unwrap();
    let topic = if reliable { "reliable" } else { "best_effort" };
    let mut ours = Ours::connect(agent, key, topic, topic, reliable);
    let until = |what: &str, ours: &mut Ours, done: &dyn Fn(&Ours) -> bool| {
        let end = Instant::now() + Duration::from_secs(20);
        while !done(ours) {
            assert!(Instant::now() < end, "in vain: {what}, {ours:?}");
            ours.turn();
            std::thread::sleep(Duration::from_micros(200));
        }
    };
    until("the session", &mut ours, &Ours::is_up);
    // The foreign agent takes a while to match its readers and writers.
    std::thread::sleep(Duration::from_millis(500));
    for number in 0..100_usize {
        ours.write(&[number as u8; 40], reliable);
        until("a sample", &mut ours, &|ours| ours.got.len() > number);
    }
    let expected: Vec<_> = (0..100).map(|number| vec![number; 40]).collect();
    assert_eq!(ours.got, expected);
}

#[test]
#[ignore = "needs a foreign agent at REPLENISH_PEER_AGENT"]
fn reliable() {
    echo(3, true);
}

#[test]
#[ignore = "needs a foreign agent at REPLENISH_PEER_AGENT"]
fn best_effort() {
    echo(4, false);
}
