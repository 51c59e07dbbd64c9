//! An agent: datagrams from several addresses, and time.
#![no_main]

#[path = "../../crates/replenish-agent/tests/fuzzed/mod.rs"]
mod fuzzed;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| fuzzed::agent::Agent::run(bytes));
