//! A1: a client of this program, `ping --echo`, whose subscription is reliable and keep-all.

use super::{agent, program, row};
use crate::common::{Running, Scratch};
use crate::stock_client::{At, HISTORY, KEEP_ALL, Stock};
use replenish_testkit::harness::{Trial, trial};
use replenish_xrce::wire::StreamId;
use std::time::{Duration, Instant};

const INT32: &str = "std_msgs::msg::dds_::Int32_";

/// Numbers that come back of so many, until nothing comes for three seconds.
fn echoed(talker: &mut Stock, listener: &mut Stock, samples: u32) -> usize {
    let (mut written, mut back, mut last) = (0, 0, Instant::now());
    while back < samples as usize && last.elapsed() < Duration::from_secs(3) {
        if written < samples && talker.under_way() < HISTORY {
            written += 1;
            talker.write(StreamId::RELIABLE, &written.to_le_bytes());
        }
        talker.turn();
        listener.turn();
        let came = std::mem::take(&mut listener.got).len();
        back += came;
        if came > 0 {
            last = Instant::now();
        }
    }
    back
}

/// b209253's client counted what it was granted by samples that it put together, its agent by those
/// that were sent.
fn a01_a_sample_too_long_for_its_reader() {
    const SAMPLES: u32 = 300;
    let scratch = Scratch::new("a01");
    let victim = agent(&scratch, &[]);
    let address = victim.at.udp.to_string();
    let args = ["ping", "--agent", &address, "--ticked", "--echo"];
    let _client = Running::start(&program(), &args);
    let at = At::Udp(victim.at.udp);
    let (mut talker, mut listener) = (Stock::new(at, 201), Stock::new(at, 202));
    talker.equip(("rt/sure", INT32), KEEP_ALL, None);
    listener.equip(("rt/sure_back", INT32), KEEP_ALL, Some(KEEP_ALL));
    listener.read(StreamId::RELIABLE);
    let begin = Instant::now();
    while echoed(&mut talker, &mut listener, 1) == 0 {
        assert!(begin.elapsed() < super::SOON, "control: it is ready");
    }
    assert_eq!(echoed(&mut talker, &mut listener, 100), 100, "control");
    talker.write(StreamId::BEST_EFFORT, &[0; 20_000]);
    let back = echoed(&mut talker, &mut listener, SAMPLES);
    let figure = format!("{back} of {SAMPLES} samples after it are heard");
    let holds = back == SAMPLES as usize;
    row("A1", "20 kB on a topic of Int32", &figure, holds);
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![trial(
        "a01_a_sample_too_long_for_its_reader",
        a01_a_sample_too_long_for_its_reader,
    )]
}
