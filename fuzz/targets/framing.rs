//! A serial line and a TCP stream; the first byte says in which pieces they come.
#![no_main]

#[path = "../../crates/replenish-agent/tests/fuzzed/mod.rs"]
mod fuzzed;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let (size, bytes) = bytes.split_first().unwrap_or((&1, &[]));
    fuzzed::decoders::framing(bytes, usize::from(*size));
});
