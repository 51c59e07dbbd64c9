//! Messages of ROS.
#![no_main]

#[path = "../../crates/replenish-agent/tests/fuzzed/mod.rs"]
mod fuzzed;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| fuzzed::cdr::every_type(bytes));
