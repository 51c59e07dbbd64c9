//! A whole RTPS participant under structured traffic of strangers, beside an honest peer.
#![no_main]

#[path = "../../crates/replenish-rtps/tests/fuzzed/mod.rs"]
mod fuzzed;

use fuzzed::datagrams::{Traffic, goodbye};
use fuzzed::node::{FIRED_AT, Pair};
use fuzzed::{Choice, Script};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let mut pair = Pair::new();
    let (writer, readers) = pair.names();
    let mut traffic = Traffic::new(FIRED_AT, writer, readers);
    let (mut script, mut buf) = (Script(bytes), [0; 4096]);
    while !script.0.is_empty() {
        let len = traffic.datagram(&mut script, &mut buf);
        pair.receive(&buf[..len]);
        if script.one_in(8) {
            pair.pass(script.below(2000) as u64 * 1_000_000);
        }
    }
    pair.strangers_go(goodbye);
});
