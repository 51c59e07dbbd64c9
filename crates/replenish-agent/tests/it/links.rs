//! Our client against our agent over links that lose, repeat, delay and overtake, in virtual time.

use crate::session::MS;
use crate::sim::{Faults, Sim};
use proptest::prelude::*;
use replenish_msg::std_msgs::{Int32, UInt8MultiArray};
use replenish_msg::{Message, decode, encode};
use replenish_xrce::client::SessionState;
use replenish_xrce::wire::StreamId;

const SECOND: u64 = 1000 * MS;

fn bytes<M: Message>(message: &M) -> Vec<u8> {
    let mut buf = vec![0; M::MAX_SIZE];
    let len = encode(message, &mut buf).unwrap();
    buf.truncate(len);
    buf
}

fn int(data: i32) -> Vec<u8> {
    bytes(&Int32 { data })
}

/// 4 kB that say which they are.
fn big(i: u8) -> Vec<u8> {
    let mut array = UInt8MultiArray::default();
    array.data.resize(4096, i).unwrap();
    bytes(&array)
}

/// Two clients that write to each other on `stream`.
fn pair(faults: impl Into<(Faults, u64)>, stream: StreamId) -> Sim {
    let mut sim = Sim::new(faults);
    for (writes, reads) in [("ping", "pong"), ("pong", "ping")] {
        let client = sim.client();
        sim.endpoint(client, writes, reads, stream);
    }
    sim.until(60 * SECOND, "both are up", Sim::all_up);
    sim
}

/// Sends `count` messages there and back, each after the one before has returned.
fn ping_pong(sim: &mut Sim, count: u8, stream: StreamId, message: impl Fn(u8) -> Vec<u8>) {
    for i in 0..count {
        for (from, to) in [(0, 1), (1, 0)] {
            sim.write(from, stream, &message(i));
            sim.until(60 * SECOND, "the message arrives", |sim| {
                sim.received(to) > usize::from(i)
            });
        }
    }
    let expected: Vec<Vec<u8>> = (0..count).map(message).collect();
    for client in [0, 1] {
        assert_eq!(sim.take(client), expected, "once each, in order, unharmed");
    }
}

const ROUGH: Faults = Faults {
    loss: 100,
    repeat: 50,
    delay: (MS / 10, 5 * MS),
};

#[test]
fn ping_pong_over_a_perfect_link_needs_no_repair() {
    for stream in [StreamId::RELIABLE, StreamId::BEST_EFFORT] {
        let mut sim = pair(Faults::NONE, stream);
        ping_pong(&mut sim, 200, stream, |i| int(i.into()));
        let stats = sim.agent.stats();
        assert_eq!((stats.samples_in, stats.samples_out), (400, 400));
        assert_eq!(
            (stats.malformed, stats.refused, stats.retransmitted),
            (0, 0, 0)
        );
    }
}

#[test]
fn a_hop_takes_one_datagram_each_way() {
    let mut sim = pair(Faults::NONE, StreamId::BEST_EFFORT);
    sim.run(50 * MS); // the last acknowledgements of the set-up
    let before = sim.agent.stats();
    ping_pong(&mut sim, 100, StreamId::BEST_EFFORT, |i| int(i.into()));
    let after = sim.agent.stats();
    assert_eq!(after.datagrams_out - before.datagrams_out, 200);
    assert_eq!(after.datagrams_in - before.datagrams_in, 200);
}

#[test]
fn reliable_int32_over_a_rough_link() {
    let mut sim = pair(ROUGH, StreamId::RELIABLE);
    ping_pong(&mut sim, 200, StreamId::RELIABLE, |i| int(i.into()));
    assert!(sim.agent.stats().retransmitted > 0, "the link was rough");
}

#[test]
fn reliable_arrays_of_4_kb_over_a_rough_link() {
    let mut sim = pair(ROUGH, StreamId::RELIABLE);
    ping_pong(&mut sim, 40, StreamId::RELIABLE, big);
}

#[test]
fn a_sample_of_more_fragments_than_may_be_under_way() {
    for faults in [Faults::NONE, ROUGH] {
        let mut sim = pair(faults, StreamId::RELIABLE);
        ping_pong(&mut sim, 5, StreamId::RELIABLE, |i| {
            (0..12_000_u32).map(|at| (at % 251) as u8 ^ i).collect()
        });
    }
}

#[test]
fn best_effort_loses_but_never_repeats_or_reorders() {
    let jitter = Faults {
        delay: (MS / 10, 3 * MS / 2),
        ..ROUGH
    };
    let mut sim = pair(jitter, StreamId::BEST_EFFORT);
    for i in 0..1000 {
        sim.write(0, StreamId::BEST_EFFORT, &int(i));
        sim.run(MS);
    }
    sim.run(SECOND);
    let got: Vec<i32> = sim
        .take(1)
        .iter()
        .map(|payload| {
            let mut message = Int32::default();
            decode(&mut message, payload).unwrap();
            message.data
        })
        .collect();
    assert!((500..1000).contains(&got.len()), "{} of 1000", got.len());
    assert!(got.is_sorted_by(|a, b| a < b));
}

#[test]
fn an_agent_that_starts_again_is_found_again() {
    for faults in [Faults::NONE, ROUGH] {
        let mut sim = pair(faults, StreamId::RELIABLE);
        ping_pong(&mut sim, 10, StreamId::RELIABLE, |i| int(i.into()));
        sim.run(2 * SECOND); // the last acknowledgements, lest something comes twice
        sim.restart_agent();
        sim.until(10 * SECOND, "they notice", |sim| !sim.all_up());
        sim.until(60 * SECOND, "they are back", Sim::all_up);
        ping_pong(&mut sim, 10, StreamId::RELIABLE, |i| int(i.into()));
    }
}

#[test]
fn an_agent_that_is_away_for_a_while_is_found_again() {
    let mut sim = pair(Faults::NONE, StreamId::RELIABLE);
    sim.agent_is_there = false;
    sim.run(8 * SECOND);
    assert!(!sim.all_up(), "silence is noticed");
    sim.agent_is_there = true;
    sim.until(10 * SECOND, "they are back", Sim::all_up);
    ping_pong(&mut sim, 10, StreamId::RELIABLE, |i| int(i.into()));
}

#[test]
fn a_client_that_starts_again_finds_its_partner_again() {
    let mut sim = pair(ROUGH, StreamId::RELIABLE);
    ping_pong(&mut sim, 10, StreamId::RELIABLE, |i| int(i.into()));
    sim.restart_client(0);
    sim.endpoint(0, "ping", "pong", StreamId::RELIABLE);
    sim.until(60 * SECOND, "it is back", Sim::all_up);
    ping_pong(&mut sim, 10, StreamId::RELIABLE, |i| int(i.into()));
    assert_eq!(sim.agent.stats().clients, 2);
}

#[test]
fn a_client_logs_out() {
    let mut sim = pair(Faults::NONE, StreamId::RELIABLE);
    sim.close(0);
    sim.until(SECOND, "it is out", |sim| {
        sim.state(0) == SessionState::Idle
    });
    assert_eq!(sim.agent.stats().clients, 1);
}

/// Sample `i` of a client: its number and a pattern; every five-hundredth has 50 kB.
fn numbered(client: usize, i: u32) -> Vec<u8> {
    let len = if i % 500 == 250 {
        50_000
    } else {
        16 + (i.wrapping_mul(0x9e37_79b9) >> 24) as usize
    };
    let pattern = (0..=255)
        .cycle()
        .map(|at: u8| at.wrapping_mul(i as u8 | 1) ^ client as u8);
    i.to_le_bytes()
        .into_iter()
        .chain(pattern)
        .take(len)
        .collect()
}

/// Two clients write to each other at the same time, through the agent: every sample crosses the
/// link twice, up on the client's stream and down on the agent's.
fn a_hundred_thousand(seed: u64, loss: u64) -> (u64, String) {
    const EACH: u32 = 50_000;
    /// Fewer than the readers' depth, so that nothing may be dropped.
    const AHEAD: u32 = 90;
    let faults = Faults {
        loss,
        repeat: 50,
        delay: (MS, 50 * MS),
    };
    let mut sim = Sim::new(faults.seeded(seed));
    for (writes, reads) in [("ping", "pong"), ("pong", "ping")] {
        let key = if writes == "ping" { 1 } else { 2 };
        let client = sim.client_with(crate::session::large_session(key, 60 * SECOND));
        sim.endpoint(client, writes, reads, StreamId::RELIABLE);
    }
    sim.until(600 * SECOND, "both are up", Sim::all_up);
    let mut written = [0_u32; 2];
    let mut seen = [0_u32; 2];
    while seen != [EACH; 2] {
        for (from, to) in [(0, 1), (1, 0)] {
            for sample in sim.take(to) {
                assert_eq!(sample, numbered(from, seen[to]), "sample {}", seen[to]);
                seen[to] += 1;
            }
            while written[from] < EACH && written[from] < seen[to] + AHEAD {
                sim.write(from, StreamId::RELIABLE, &numbered(from, written[from]));
                written[from] += 1;
            }
        }
        if seen != [EACH; 2] {
            sim.until(600 * SECOND, "something arrives", |sim| {
                sim.received(0) + sim.received(1) > 0
            });
        }
    }
    sim.run(10 * SECOND);
    assert_eq!((sim.received(0), sim.received(1)), (0, 0), "nothing twice");
    (sim.now(), format!("{:?}", sim.agent.stats()))
}

#[test]
fn a_hundred_thousand_messages_both_ways_over_bad_links() {
    for loss in [0, 100, 300] {
        let run = a_hundred_thousand(loss + 7, loss);
        println!("loss {loss} in 1000: {run:?}");
        if loss == 100 {
            let again = a_hundred_thousand(loss + 7, loss);
            assert_eq!(run, again, "the same seed gives the same run");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    /// Bursts, so that several messages are under way both ways while the link is at its worst.
    #[test]
    fn reliable_bursts_arrive_once_and_in_order(
        seed: u64,
        loss in 0_u64..300,
        repeat in 0_u64..200,
        jitter in 1_u64..20,
    ) {
        let faults = Faults { loss, repeat, delay: (MS / 10, jitter * MS) };
        let mut sim = pair(faults.seeded(seed), StreamId::RELIABLE);
        let mut sent = 0_u8;
        for burst in 1..8 {
            for _ in 0..burst {
                for client in [0, 1] {
                    sim.write(client, StreamId::RELIABLE, &int(sent.into()));
                }
                sent += 1;
            }
            sim.run(3 * MS);
        }
        sim.until(60 * SECOND, "all arrive", |sim| {
            [0, 1].iter().all(|client| sim.received(*client) >= sent.into())
        });
        sim.run(SECOND);
        let expected: Vec<Vec<u8>> = (0..sent).map(|i| int(i.into())).collect();
        prop_assert_eq!(sim.take(0), &expected[..]);
        prop_assert_eq!(sim.take(1), &expected[..]);
    }
}
