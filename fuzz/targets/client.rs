//! A client session: datagrams, time, and what an application does.
#![no_main]

#[path = "../../crates/replenish-agent/tests/fuzzed/mod.rs"]
mod fuzzed;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| fuzzed::client::Client::run(bytes));
