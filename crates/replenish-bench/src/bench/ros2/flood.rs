//! A control loop beside a flood on another topic: the worker of the flood pays for it.
//!
//! ```text
//!   ping ──► control: worker "control" answers, worker "flood" has a budget of its own, same CPU
//!   flood ─► control, 50 000 messages a second, best effort, from another CPU
//! ```
//!
//! Windows with and without the flood take turns.

use super::pair::{Pair, Process};
use super::path::Path;
use super::report::Flood;
use super::windows::{OFF, ON, Plan};
use crate::load::{MS, Nanos, SEC};
use replenish_cli::machine::stats::{Sorted, us};
use replenish_cli::outcome::Failure;
use replenish_os::{Policy, ThreadSpec, clock, spawn};

/// Messages of the flood in a second.
pub(super) const RATE: u64 = 50_000;
/// Bytes of a control message.
const BYTES: usize = 64;

/// Measures it; `starter` is the thread that starts the receiving processes, `support` the CPU of
/// the flood.
pub(super) fn measure(plan: &Plan, starter: &ThreadSpec, support: usize) -> Result<Flood, Failure> {
    let panicked = |_| Failure::refused("a thread panicked");
    let domain = plan.domains.first().copied().unwrap_or_default();
    let start = spawn(starter.clone(), move || {
        Pair::start_with(Path::Executor, "control", domain)
    });
    let pair = start
        .map_err(Failure::refused)?
        .join()
        .map_err(panicked)??;
    let mut pair = pair.map_err(Failure::refused)?;
    let start = ThreadSpec::new("flood").policy(Policy::Other).cpu(support);
    let flood = spawn(start, move || {
        Process::part(Path::Executor, "flood", domain)
    });
    let flood = flood
        .map_err(Failure::refused)?
        .join()
        .map_err(panicked)??;
    let mut flood = flood.map_err(Failure::refused)?;
    flood.line()?;
    let (mut quiet, mut flooded, mut sent) = (Vec::new(), Vec::new(), 0);
    // Samples that were lost during discovery are not counted.
    let before = dropped(&mut pair)?;
    for round in 0..=plan.windows {
        for with in [false, true] {
            if with {
                flood.tell(&format!("flood {}", ON + 20 * MS))?;
                clock::sleep_until(clock::monotonic() + 10 * MS);
            }
            let window = pair.window(BYTES, ON / MS, MS)?;
            if with {
                sent += number(&flood.line()?)?;
            }
            clock::sleep_until(clock::monotonic() + 2 * OFF);
            if round > 0 {
                let times = if with { &mut flooded } else { &mut quiet };
                times.extend(window.times);
            }
        }
    }
    Ok(Flood {
        quiet_p99_us: us(Sorted::new(quiet).percentile(99)),
        flood_p99_us: us(Sorted::new(flooded).percentile(99)),
        sent,
        dropped: dropped(&mut pair)?.saturating_sub(before),
    })
}

fn dropped(pair: &mut Pair) -> Result<u64, Failure> {
    number(&pair.ask_echo("lost")?)
}

fn number(line: &str) -> Result<u64, Failure> {
    let word = line.split(' ').nth(1).unwrap_or_default();
    word.parse()
        .map_err(|_| Failure::refused(format!("{line:?} is no number")))
}

/// Sends 50 messages each millisecond through `publish` for so long; how many.
pub(super) fn pour(time: Nanos, publish: &mut dyn FnMut()) -> u64 {
    let (begin, mut sent) = (clock::monotonic(), 0);
    let due = |now: Nanos| (now - begin) * RATE / SEC;
    while clock::monotonic() < begin + time {
        let now = clock::monotonic();
        while sent < due(now) {
            publish();
            sent += 1;
        }
        clock::sleep_until(now + MS);
    }
    sent
}
