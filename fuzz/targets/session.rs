//! Whole sessions, client against agent, with faults from the fuzzer's bytes.
#![no_main]

#[path = "../../crates/replenish-agent/tests/support/schedule.rs"]
mod schedule;
#[path = "../../crates/replenish-agent/tests/support/session.rs"]
mod session;
#[path = "../../crates/replenish-agent/tests/support/sim.rs"]
mod sim;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    schedule::run(&bytes[..bytes.len().min(600)]);
});
