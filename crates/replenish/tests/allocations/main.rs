//! After the start nothing allocates. One after another: the counter sees every thread of the
//! process.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

#[path = "../common/mod.rs"]
mod common;

mod actions;
mod executor;
mod handles;
mod large;
mod rtps;
mod xrce;

use replenish_testkit::alloc::CountingAllocator;

#[global_allocator]
static ALLOC: CountingAllocator = CountingAllocator::new();

fn main() {
    replenish_testkit::harness::run_in_turn([
        ("actions", actions::trials()),
        ("executor", executor::trials()),
        ("handles", handles::trials()),
        ("large", large::trials()),
        ("rtps", rtps::trials()),
        ("xrce", xrce::trials()),
    ])
}
