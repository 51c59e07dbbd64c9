//! Slow and obvious models the servers are compared with, and the checks that hold in every state.

#![allow(dead_code, unreachable_pub, reason = "each test binary uses its part")]
pub mod checked;
pub mod posix_model;
pub mod simulator;
pub mod units;
pub mod world;

use sporadic::{BudgetServer, Chunk, Corrected, Level, Low, Nanos, Params};

pub fn params(budget: Nanos, period: Nanos, max_repl: u16) -> Params {
    Params::new(60, Low::Background(6), budget, period, max_repl).unwrap()
}

pub fn corrected(budget: Nanos, period: Nanos, max_repl: u16) -> Corrected<128> {
    Corrected::new(params(budget, period, max_repl), 0).unwrap()
}

pub fn posix(budget: Nanos, period: Nanos, max_repl: u16) -> sporadic::Posix<128> {
    sporadic::Posix::new(params(budget, period, max_repl), 0).unwrap()
}

/// The chunks as pairs, for comparison with hand-made lists.
pub fn pairs(chunks: impl Iterator<Item = Chunk>) -> Vec<(Nanos, Nanos)> {
    chunks.map(|chunk| (chunk.time, chunk.amount)).collect()
}

/// One entry per unit of budget: when it is available, in order.
pub fn unit_times<const N: usize>(server: &Corrected<N>) -> Vec<Nanos> {
    server
        .chunks()
        .flat_map(|chunk| std::iter::repeat_n(chunk.time, usize::try_from(chunk.amount).unwrap()))
        .collect()
}

/// The promises of any server in any state, after `update(now)`.
pub fn check_answers(server: &impl BudgetServer, level: Level, now: Nanos) {
    let available = server.available(now);
    assert!(
        available <= server.params().budget(),
        "available {available} is above B"
    );
    assert_eq!(
        level == Level::High,
        available > 0,
        "{level:?} with {available} available"
    );
    match (level, server.next_replenishment()) {
        (Level::High, None) => {}
        (Level::Low, Some(time)) => assert!(time > now, "next replenishment {time} at {now}"),
        other => panic!("level and next replenishment disagree: {other:?}"),
    }
}

/// The structure of the corrected server, in any state. (Times saturate, so several may be the
/// very last.)
pub fn check_chunks<const N: usize>(server: &Corrected<N>) {
    let params = server.params();
    let chunks: Vec<Chunk> = server.chunks().collect();
    assert_eq!(
        chunks.iter().map(|c| c.amount).sum::<Nanos>(),
        params.budget(),
        "sum is not B"
    );
    assert!(
        chunks.iter().all(|c| c.amount > 0),
        "empty chunk: {chunks:?}"
    );
    assert!(
        chunks
            .windows(2)
            .all(|w| w[0].time < w[1].time || w[1].time == Nanos::MAX),
        "not in order: {chunks:?}"
    );
    assert!(
        chunks[chunks.len() - 1].time - chunks[0].time <= params.period(),
        "{chunks:?}"
    );
    assert!(
        chunks.len() <= 1 + usize::from(params.max_repl()),
        "too many: {chunks:?}"
    );
    assert!(server.pending() <= chunks.len());
    let head_suffices = chunks[0].amount >= server.min_chunk() || chunks.len() == 1;
    assert!(head_suffices, "sliver at the head: {chunks:?}");
}

/// The theorem: for every window [t, t+T), what was consumed with an effective activation in it
/// sums to at most B. `log` has (activation, amount). A window that holds the most can be moved
/// to start at an activation, so those starts suffice.
pub fn check_theorem(log: &[(Nanos, Nanos)], budget: Nanos, period: Nanos) {
    for &(start, _) in log {
        let inside = log
            .iter()
            .filter(|&&(e, _)| start <= e && e - start < period);
        let sum: Nanos = inside.map(|&(_, amount)| amount).sum();
        assert!(
            sum <= budget,
            "{sum} units in [{start}, {start}+{period}): {log:?}"
        );
    }
}

/// The most that was executed in any window of length `period`. `runs` are disjoint intervals.
/// The sum is piecewise linear in the start of the window, so its maximum is where the window
/// starts at the start of a run or ends at the end of one.
pub fn busiest_window(runs: &[(Nanos, Nanos)], period: Nanos) -> Nanos {
    let starts = runs.iter().map(|&(from, _)| from);
    let ends = runs.iter().map(|&(_, to)| to.saturating_sub(period));
    let executed = |start: Nanos| -> Nanos {
        let overlap =
            |&(from, to): &(Nanos, Nanos)| to.min(start + period).saturating_sub(from.max(start));
        runs.iter().map(overlap).sum()
    };
    starts.chain(ends).map(executed).max().unwrap_or(0)
}
