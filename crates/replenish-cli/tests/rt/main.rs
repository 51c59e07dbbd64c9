//! The robot's command where it needs real-time priority: `run`, `adopt` and `why`.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod foreign;
mod foreign_admitted;
mod foreign_torture;
#[path = "../it/schema.rs"]
mod schema;
mod why;

fn main() {
    replenish_testkit::harness::run_in_turn([
        ("foreign", foreign::trials()),
        ("foreign_admitted", foreign_admitted::trials()),
        ("foreign_torture", foreign_torture::trials()),
        ("why", why::trials()),
    ])
}
