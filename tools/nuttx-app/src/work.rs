//! Bursts: 10 ms of the calling thread's CPU time, however often it is preempted meanwhile.

use core::hint::black_box;
use replenish_os::clock;

const BURST: u64 = 10_000_000;

/// Burns 10 ms and up to 5 us.
pub(crate) fn burst() {
    let end = clock::thread_cpu() + BURST;
    while clock::thread_cpu() < end {
        for i in 0..100 {
            black_box(i);
        }
    }
}
