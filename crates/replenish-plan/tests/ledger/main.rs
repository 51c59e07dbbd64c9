//! The ledger between processes and accounts.
//!
//! Trials under the test kit's harness: another account needs root, and without it they count as
//! ignored.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::zombie_processes,
    reason = "tests may panic"
)]

mod attacked;
mod processes;

fn main() {
    if let Ok(args) = std::env::var(processes::CHILD) {
        return processes::child(&args);
    }
    replenish_testkit::harness::run_in_turn([
        ("processes", processes::trials()),
        ("attacked", attacked::trials()),
    ])
}
