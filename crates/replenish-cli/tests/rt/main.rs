//! The robot's command where it needs real-time priority: `run`, `adopt` and `why`.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod foreign;
#[path = "../it/schema.rs"]
mod schema;
mod why;

fn main() {
    replenish_testkit::harness::run_in_turn([
        ("foreign", foreign::trials()),
        ("why", why::trials()),
    ])
}
