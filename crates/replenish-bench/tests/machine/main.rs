//! The command against what a machine may lack: real-time priority, other accounts, IPv6, a DDS
//! program. Trials that lack it count as ignored.
//!
//! The command takes the machine-wide lock itself, so these trials do not.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

#[path = "../common/mod.rs"]
mod common;

#[path = "../../../replenish-agent/tests/support/cyclone.rs"]
mod cyclone;
#[path = "../../../replenish-agent/tests/support/stock_client.rs"]
mod stock_client;

#[path = "../it/attacker.rs"]
#[allow(dead_code, reason = "`it` uses the rest")]
mod attacker;
#[path = "../it/memory/mod.rs"]
#[allow(dead_code, unused_imports, reason = "its tests run in `it`")]
mod memory;

mod agent;
mod demo;
mod recorded;
mod ros2;
mod rows;

fn main() {
    replenish_testkit::harness::run_together([
        ("agent", agent::trials()),
        ("demo", demo::trials()),
        ("recorded", recorded::trials()),
        ("ros2", ros2::trials()),
        ("rows", rows::trials()),
    ])
}
