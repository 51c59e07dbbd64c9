//! An RTPS message, its submessages, and the samples of discovery and of the graph in it.
#![no_main]

#[path = "../../crates/replenish-rtps/tests/fuzzed/mod.rs"]
mod fuzzed;

use fuzzed::decoders;
use libfuzzer_sys::fuzz_target;
use replenish_rtps::ros::KnownNodes;

fuzz_target!(|bytes: &[u8]| decoders::datagram(bytes, &mut KnownNodes::new(decoders::NODES)));
