//! Acknowledged samples have arrived: agents that are killed at any moment take nothing along, and
//! a reader that is stuck does not hold up its writer.

use crate::session::{MS, endpoints, session_with};
use crate::sim::{Faults, Sim};
use crate::support::{Client, Got, World, data};
use replenish_agent::Limits;
use replenish_xrce::client::Config;
use replenish_xrce::wire::{ClientKey, DeliveryControl, StreamId};
use std::collections::BTreeMap;

const SECOND: u64 = 1000 * MS;

/// A sample that is long enough for a message of its own.
fn sample(number: u32) -> Vec<u8> {
    let mut sample = vec![number as u8; 300];
    sample[..4].copy_from_slice(&number.to_le_bytes());
    sample
}

fn number(sample: &[u8]) -> u32 {
    let (number, rest) = sample.split_first_chunk().unwrap();
    assert!(rest.iter().all(|byte| *byte == number[0]), "damaged");
    u32::from_le_bytes(*number)
}

/// A writer, client 0, and two readers of its topic.
fn network(faults: Faults, seed: u64) -> Sim {
    let mut sim = Sim::new((faults, seed));
    for (key, writes, reads) in [(1, "steady", "x"), (2, "y", "steady"), (3, "z", "steady")] {
        let config = Config {
            confirm_delivery: true,
            ..Config::new(ClientKey([key; 4]))
        };
        let mut session = session_with(config, 800 * MS);
        endpoints(&mut session, writes, reads, StreamId::RELIABLE);
        sim.client_with(session);
    }
    sim.until(60 * SECOND, "all are up", Sim::all_up);
    sim
}

#[test]
fn what_was_acknowledged_came_once_whenever_the_agent_is_killed() {
    const KILLS: u64 = 4;
    let rough = Faults {
        loss: 100,
        repeat: 50,
        delay: (MS, 5 * MS),
    };
    let (mut certain, mut repeated) = (0, 0);
    for seed in 1..=120 {
        let faults = if seed % 3 == 0 { rough } else { Faults::NONE };
        let mut sim = network(faults, seed * 0x9e37_79b9);
        let mut random = seed;
        let mut draw = |below: u64| {
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695);
            (random >> 33) % below
        };
        let mut next = 0;
        let mut acknowledged = Vec::new();
        for _ in 0..KILLS {
            let life = 20 + draw(200);
            for _ in 0..life {
                sim.write(0, StreamId::RELIABLE, &sample(next));
                next += 1;
                sim.run(MS / 2 + draw(MS));
            }
            let since = acknowledged.last().map_or(0, |last| last + 1);
            let until = sim.taken(0) - sim.session(0).unacknowledged();
            acknowledged.extend(since..until);
            sim.agent_is_there = false;
            sim.run(draw(1500) * MS);
            sim.restart_agent();
            sim.agent_is_there = true;
        }
        sim.until(60 * SECOND, "they are back", Sim::all_up);
        let all = usize::try_from(next).unwrap();
        sim.until(60 * SECOND, "everything is acknowledged", |sim| {
            sim.taken(0) == all && sim.session(0).is_delivered()
        });
        let carried = sim.session(0).link_stats().carried;
        for reader in [1, 2] {
            let mut times = BTreeMap::<u32, u64>::new();
            let mut newest = None;
            for got in sim.take(reader) {
                let number = number(&got);
                let first = times
                    .insert(number, 1 + times.get(&number).unwrap_or(&0))
                    .is_none();
                assert!(!first || newest < Some(number), "seed {seed}: order");
                newest = newest.max(Some(number));
            }
            let lacks: Vec<u32> = (0..next).filter(|n| !times.contains_key(n)).collect();
            assert_eq!(lacks, [0; 0], "seed {seed}: reader {reader} lacks these");
            for number in &acknowledged {
                let number = u32::try_from(*number).unwrap();
                assert_eq!(
                    times[&number], 1,
                    "seed {seed}: {number} at reader {reader}"
                );
            }
            let again: u64 = times.values().map(|times| times - 1).sum();
            assert!(again <= carried, "seed {seed}: {again} of {carried}");
            repeated += again;
        }
        certain += acknowledged.len();
        assert_eq!(sim.session(0).link_stats().lost, 0);
    }
    println!("{certain} were acknowledged before a kill; {repeated} others came again");
    assert!(certain > 10_000, "{certain}");
}

#[test]
fn publishing_is_as_fast_as_without() {
    // 5 ms each way: an acknowledgement takes 10 ms, a confirmation 20 ms.
    let far = Faults {
        loss: 0,
        repeat: 0,
        delay: (5 * MS, 5 * MS),
    };
    let mut sim = network(far, 1);
    for i in 0..800 {
        sim.write(0, StreamId::RELIABLE, &sample(i));
    }
    sim.run(SECOND / 2);
    // 16 messages for each 10 ms.
    let received = sim.received(1);
    assert!(
        (700..=800).contains(&received),
        "{received} in half a second"
    );
}

/// A stock client that writes, and one that reads all of it and acknowledges nothing.
fn talker_and_silent_listener(world: &mut World) -> (Client, Client) {
    let (mut talker, mut listener) = (Client::open(world, 1, 1), Client::open(world, 2, 2));
    talker.endpoint(world, true, None);
    listener.endpoint(world, false, Some(10));
    listener.read(
        world,
        1,
        StreamId::RELIABLE,
        Some(DeliveryControl::UNLIMITED),
    );
    listener.acknowledging = false;
    (talker, listener)
}

#[test]
fn a_stock_client_is_told_when_its_sample_has_arrived() {
    let world = &mut World::new(Limits::DEFAULT);
    let (mut talker, mut listener) = talker_and_silent_listener(world);
    let before = talker.acknowledged(world);
    talker.write(world, 1, b"safe");
    assert_eq!(talker.acknowledged(world), None, "not yet");
    assert_eq!(listener.got(world), [data(1, b"safe")]);
    assert_eq!(talker.acknowledged(world), None, "not yet");
    listener.acknowledge(world);
    assert_eq!(talker.acknowledged(world), before.map(|seq| seq + 1));
}

#[test]
fn a_reader_that_is_stuck_holds_up_its_writer_once_and_briefly() {
    let world = &mut World::new(Limits::DEFAULT);
    let (mut talker, mut listener) = talker_and_silent_listener(world);
    let _ = talker.acknowledged(world);
    talker.write(world, 1, b"one.");
    world.pass(499 * MS);
    assert_eq!(talker.acknowledged(world), None);
    world.pass(MS);
    let one = talker.acknowledged(world).expect("half a second is enough");
    assert_eq!(world.agent.stats().confirmed_late, 1);
    for i in 1..100 {
        talker.write(world, 1, &[i; 4]);
        assert_eq!(
            talker.acknowledged(world),
            Some(one + u16::from(i)),
            "at once"
        );
    }
    assert_eq!(world.agent.stats().confirmed_late, 1);
    // It is waited for again once it has caught up.
    listener.acknowledging = true;
    let got: Vec<Got> = listener.acknowledge(world);
    assert!(!got.is_empty());
    listener.acknowledging = false;
    talker.write(world, 1, b"two.");
    assert_eq!(talker.acknowledged(world), None, "not yet");
    assert_eq!(listener.got(world), [data(1, b"two.")]);
    listener.acknowledge(world);
    assert_eq!(talker.acknowledged(world), Some(one + 100));
}
