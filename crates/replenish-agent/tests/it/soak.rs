//! The soak: reliable keep-all samples through loss, duplicates, reordering and damage, while a
//! reader stalls for seconds and every process is killed in turn. In virtual time; a seed replays
//! it.
//!
//! `REPLENISH_SOAK=1000000 REPLENISH_SEED=7 cargo test -p replenish-agent --test it -- --nocapture
//! a_soak` for as many samples as you like.

use crate::session::MS;
use crate::sim::{Faults, Sim, member, network};
use replenish_xrce::client::SessionState;
use replenish_xrce::wire::StreamId;
use std::ops::Range;
use std::time::Instant;

const SECOND: u64 = 1000 * MS;

/// A tenth is lost. A bit is damaged in 2 % of the rest, which UDP's checksum finds: lost, too.
const ROUGH: Faults = Faults {
    loss: 118,
    repeat: 50,
    delay: (MS / 2, 3 * MS),
};

fn from_env(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |value| value.parse().unwrap())
}

/// The fault that ends a part of the soak.
#[derive(Clone, Copy, Debug)]
enum Fault {
    Agent,
    Publisher,
    Reader,
    Stall,
}

const SCHEDULE: [Fault; 14] = [
    Fault::Agent,
    Fault::Stall,
    Fault::Reader,
    Fault::Agent,
    Fault::Publisher,
    Fault::Stall,
    Fault::Agent,
    Fault::Stall,
    Fault::Reader,
    Fault::Agent,
    Fault::Publisher,
    Fault::Stall,
    Fault::Agent,
    Fault::Stall,
];

/// Before the pushing back of keep-all readers, a stall of more than a second dropped what had been
/// acknowledged.
#[test]
fn a_soak_loses_nothing_that_was_acknowledged() {
    let samples = u32::try_from(from_env("REPLENISH_SOAK", 15_000)).unwrap();
    let seed = from_env("REPLENISH_SEED", 1);
    let began = Instant::now();
    let mut sim = network(seed);
    sim.faults = ROUGH;
    let part = samples.div_ceil(u32::try_from(SCHEDULE.len() + 1).unwrap());
    let (mut next, mut acknowledged) = (0_u32, Vec::<Range<usize>>::new());
    let (mut first, mut stalled, mut late) = (0_usize, 0_u64, 0_u64);
    for fault in SCHEDULE.iter().map(Some).chain([None]) {
        let end = samples.min(next + part);
        while next < end {
            if sim.waiting(0) < 64 {
                // Long enough for a message of its own: messages are counted below.
                sim.write(0, StreamId::RELIABLE, &[next.to_le_bytes(); 75].concat());
                next += 1;
            } else {
                sim.run(MS);
            }
        }
        match fault {
            Some(Fault::Agent) => {
                late += sim.agent.stats().confirmed_late;
                sim.agent_is_there = false;
                sim.run(300 * MS);
                sim.restart_agent();
                sim.agent_is_there = true;
            }
            Some(Fault::Publisher) => {
                let until = sim.taken(0) - sim.session(0).unacknowledged();
                acknowledged.push(first..until);
                first = sim.taken(0);
                sim.replace(0, member(1, "steady", "x"));
            }
            Some(Fault::Reader) => sim.replace(2, member(3, "z", "steady")),
            Some(Fault::Stall) => {
                sim.pause(1, true);
                sim.run(5 * SECOND);
                sim.pause(1, false);
            }
            None => {}
        }
        let at = sim.now();
        let up = |sim: &Sim| (0..3).all(|client| sim.state(client) == SessionState::Up);
        sim.until(10 * SECOND, "all are up after a fault", up);
        // An agent that dies while a reader is behind takes along what waits for it, as documented.
        sim.until(60 * SECOND, "all have caught up", |sim| {
            sim.waiting(0) == 0 && sim.session(0).is_delivered()
        });
        stalled = stalled.max(sim.now() - at);
    }
    sim.run(SECOND);
    late += sim.agent.stats().confirmed_late;
    acknowledged.push(first..sim.taken(0));
    let certain: usize = acknowledged.iter().map(ExactSizeIterator::len).sum();
    let mut seen = vec![0_u8; samples as usize];
    for got in sim.take(1) {
        let (number, rest) = got.split_first_chunk::<4>().unwrap();
        assert!(rest.chunks(4).all(|chunk| chunk == number), "damaged");
        seen[u32::from_le_bytes(*number) as usize] += 1;
    }
    let lacks = acknowledged
        .iter()
        .cloned()
        .flatten()
        .filter(|n| seen[*n] == 0)
        .count();
    let twice = seen.iter().filter(|times| **times > 1).count();
    let other = sim.take(2).len();
    println!(
        "seed {seed}: {samples} written, {certain} acknowledged for certain, {lacks} of them \
         missing, {twice} came again; the reader that was killed twice got {other}; longest \
         recovery after a fault {} ms; {late} confirmed late; {} s virtual, {:.1} s real",
        stalled / MS,
        sim.now() / SECOND,
        began.elapsed().as_secs_f64()
    );
    assert_eq!(lacks, 0, "seed {seed}");
    assert!(seen.iter().all(|times| *times <= 3), "seed {seed}");
    assert!(
        certain + 2 * 512 >= samples as usize,
        "{certain} of {samples}"
    );
}
