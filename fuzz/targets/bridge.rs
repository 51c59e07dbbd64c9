//! The agent's seam to DDS: clients create, write and vanish, and the other side brings samples,
//! requests and replies for endpoints that are there, or were.
#![no_main]

#[path = "../../crates/replenish-agent/tests/fuzzed/mod.rs"]
mod fuzzed;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| fuzzed::bridge::Bridged::run(bytes));
