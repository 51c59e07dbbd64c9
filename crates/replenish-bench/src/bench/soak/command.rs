//! `replenish bench soak`: the faults one after another, and the verdict.

use super::ledger::Verdict;
use super::options::{Args, Fault};
use super::part;
use super::proxy::Counts;
use super::world::World;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

/// `bench soak --json`. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct Json<'a> {
    seed: u64,
    seconds: f64,
    agents_killed: usize,
    publishers_killed: usize,
    readers_killed: usize,
    stalls: usize,
    /// From the end of a fault to everything delivered, at worst.
    longest_recovery_ms: u128,
    /// The longest time without a sample while samples were written after the last fault.
    longest_stall_ms: u128,
    datagrams: &'a Counts,
    #[serde(flatten)]
    verdict: Verdict,
}

/// Runs the soak, or is one of its parts.
pub(crate) fn run(args: &Args) -> Outcome {
    if let (Some(part), Some(at)) = (args.part, args.at) {
        return part::run(part, at, args.key, args.first);
    }
    files::check_writable(args.json.json.as_deref())?;
    let began = Instant::now();
    let mut world = World::start(args)?;
    let parts = u32::try_from(args.faults.len() + 1).unwrap_or(u32::MAX);
    let part = args.samples.div_ceil(parts);
    let time = Duration::from_secs(args.seconds) / parts;
    let mut recovery = Duration::ZERO;
    for fault in &args.faults {
        world.write(part, Instant::now() + time)?;
        world.suffer(*fault)?;
        let end = Instant::now();
        world.catch_up()?;
        recovery = recovery.max(end.elapsed());
    }
    let ledger = Arc::clone(&world.ledger);
    let ledger = || ledger.lock().unwrap_or_else(PoisonError::into_inner);
    ledger().mark();
    world.write(part, Instant::now() + time)?;
    world.catch_up()?;
    world.end();
    let count = |fault| args.faults.iter().filter(|f| **f == fault).count();
    let counts = Arc::clone(&world.proxy.counts);
    let longest = ledger().longest();
    let verdict = ledger().verdict();
    let json = Json {
        seed: args.seed,
        seconds: began.elapsed().as_secs_f64(),
        agents_killed: count(Fault::Agent),
        publishers_killed: count(Fault::Publisher),
        readers_killed: count(Fault::Reader),
        stalls: count(Fault::Stall),
        longest_recovery_ms: recovery.as_millis(),
        longest_stall_ms: longest.as_millis(),
        datagrams: &counts,
        verdict,
    };
    drop(world);
    println!("{}", text(&json));
    files::write_json(args.json.json.as_deref(), "bench-soak", &json)?;
    let verdict = &json.verdict;
    if verdict.missing + verdict.more + verdict.damaged > 0 {
        return Err(Failure::refused(format!(
            "of {} acknowledged samples {} are missing; {} came more than twice, {} damaged",
            verdict.acknowledged, verdict.missing, verdict.more, verdict.damaged
        )));
    }
    Ok(())
}

fn text(json: &Json<'_>) -> String {
    let v = &json.verdict;
    let d = json.datagrams;
    format!(
        "{} samples acknowledged, {} of them missing; {} came twice, {} more often, {} damaged; {} \
         not covered\n\
         agent killed {} times, publisher {}, reader {}; {} stalls; longest recovery {} ms, longest \
         stall after the last fault {} ms\n\
         datagrams: {:?} passed, {:?} lost, {:?} repeated, {:?} damaged; seed {}, {:.1} s",
        v.acknowledged,
        v.missing,
        v.twice,
        v.more,
        v.damaged,
        v.not_covered,
        json.agents_killed,
        json.publishers_killed,
        json.readers_killed,
        json.stalls,
        json.longest_recovery_ms,
        json.longest_stall_ms,
        d.passed,
        d.lost,
        d.repeated,
        d.damaged,
        json.seed,
        json.seconds
    )
}
