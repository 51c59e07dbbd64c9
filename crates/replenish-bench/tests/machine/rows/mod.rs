//! The attacks that b209253 fell to (A1 to A19), from outside.
//!
//! The path of the attacked program is given. The attacks come over sockets, files and signals,
//! with requests that b209253 and today's program understand. Each row begins with a control that
//! both pass, so that a row that falls falls by its attack.
//!
//! ```sh
//! test="cargo test -p replenish-bench --test machine rows::"
//! $test -- --test-threads 1                           # today's program
//! export REPLENISH_AGENT_PROGRAM=/path/to/replenish   # from here on another one
//! $test -- --test-threads 1
//! ```

mod bridge;
mod client;
mod delivery;
mod ledger;
mod process;
mod strangers;

use crate::common::{BIN, Scratch};
use crate::memory::Victim;
use replenish_testkit::harness::Trial;
use std::time::{Duration, Instant};

const SOON: Duration = Duration::from_secs(20);

/// The program that is attacked.
fn program() -> String {
    std::env::var("REPLENISH_AGENT_PROGRAM").unwrap_or_else(|_| BIN.into())
}

/// Its agent.
fn agent(scratch: &Scratch, options: &[&str]) -> Victim {
    let options: Vec<String> = options.iter().map(|&option| option.into()).collect();
    Victim::of(&program(), scratch, "agent", &options)
}

/// Prints a row, and fails if the program fell.
fn row(id: &str, attack: &str, figure: &str, holds: bool) {
    let verdict = if holds { "holds" } else { "falls" };
    println!("\n| {id} | {attack} | {figure} | {verdict} |");
    assert!(holds, "{id}: {figure}");
}

/// Whether it holds within `limit`.
fn within(limit: Duration, mut holds: impl FnMut() -> bool) -> bool {
    let end = Instant::now() + limit;
    loop {
        if holds() {
            return true;
        }
        if Instant::now() > end {
            return false;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

pub(crate) fn trials() -> Vec<Trial> {
    let parts = [
        bridge::trials(),
        client::trials(),
        delivery::trials(),
        ledger::trials(),
        process::trials(),
        strangers::trials(),
    ];
    parts.into_iter().flatten().collect()
}
