//! Burning CPU time: by a counted loop, calibrated against the clock of the calling task, so that a
//! burst takes its CPU time however often the task is preempted.

use core::hint::black_box;
use replenish_os::clock;

/// Loop rounds per 10 ms of CPU time.
#[derive(Clone, Copy)]
pub struct Burst(u32);

impl Burst {
    /// Measures a loop of a known length; for a task that is not preempted meanwhile.
    pub fn calibrate() -> Self {
        const ROUNDS: u32 = 200_000;
        let before = clock::thread_cpu();
        spin(ROUNDS);
        let took = clock::thread_cpu() - before;
        Self((u64::from(ROUNDS) * 10_000_000 / took.max(1)) as u32)
    }

    /// Burns this many microseconds of CPU time.
    pub fn run_us(self, us: u32) {
        spin((u64::from(self.0) * u64::from(us) / 10_000) as u32);
    }

    /// Burns until the calling task has consumed `target` ns of CPU time in all, within 2 us. The
    /// clock is read a few times only: QEMU leaves its translated code for it.
    pub fn until(self, target: u64) {
        while let left @ 1.. = target.saturating_sub(clock::thread_cpu()) {
            // A little less than what is left, so that it is not overshot.
            spin((left * u64::from(self.0) / 10_100_000) as u32);
        }
    }

    /// 10 ms of CPU time.
    pub fn run(self) {
        spin(self.0);
    }
}

#[inline(never)] // one loop for the calibration and for what it is for
fn spin(rounds: u32) {
    for i in 0..rounds {
        black_box(i);
    }
}
