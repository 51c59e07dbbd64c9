//! Burning CPU time: by a counted loop, calibrated against the clock of the calling thread, so that
//! a burst takes its CPU time however often the thread is preempted.

use core::hint::black_box;
use replenish_os::clock;

/// Loop rounds per 10 ms of CPU time.
#[derive(Clone, Copy)]
pub(crate) struct Burst(u32);

impl Burst {
    /// Measures a loop of a known length; for a thread that is not preempted meanwhile.
    pub(crate) fn calibrate() -> Self {
        const ROUNDS: u32 = 2_000_000;
        let from = clock::monotonic();
        spin(ROUNDS);
        let took = clock::monotonic() - from;
        let rounds = u64::from(ROUNDS) * 10_000_000 / took.max(1);
        Self(u32::try_from(rounds).unwrap_or(u32::MAX))
    }

    pub(crate) fn run(self) {
        spin(self.0);
    }
}

#[inline(never)] // one loop, wherever it is called from
fn spin(rounds: u32) {
    for i in 0..rounds {
        black_box(i);
    }
}
