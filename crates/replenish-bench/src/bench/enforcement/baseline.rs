//! The baseline: a POSIX CPU timer on a spinning thread, which the kernel looks at on its tick.

use super::schedule::{Schedule, WORKER_PRIORITY};
use crate::load::{MS, Nanos};
use replenish_cli::outcome::Failure;
use replenish_cli::signals::Stop;
use replenish_os::baseline::CpuTimer;
use replenish_os::{Policy, Thread, ThreadSpec, Tid, clock, spawn};
use std::fmt::Display;

/// The longest tick of a Linux kernel (HZ=100).
const MAX_TICK: Nanos = 10 * MS;

/// The golden section of it: shots spread evenly over the tick, whatever their number.
const PHASE_STEP: Nanos = 6_180_340;

/// A spinning thread and the one that its timer wakes.
pub(super) struct Baseline {
    spinner: Thread<()>,
    watcher: Thread<std::io::Result<Vec<i64>>>,
}

impl Baseline {
    /// Starts both on `cpu`; the budget of each shot is `budget` of the spinner's CPU time.
    pub(super) fn start(
        cpu: usize,
        budget: Nanos,
        schedule: Schedule,
        stop: &Stop,
    ) -> Result<Self, Failure> {
        let spec = |name: &str, priority| {
            Policy::fifo(priority)
                .map(|policy| ThreadSpec::new(name).policy(policy).cpu(cpu))
                .map_err(|e| failed(&e))
        };
        let stopping = stop.clone();
        let spinner = spawn(spec("posix/spinner", WORKER_PRIORITY)?, move || {
            for window in schedule.windows() {
                clock::sleep_until(window.start);
                while !stopping.is_triggered() && clock::monotonic() < window.end {
                    std::hint::spin_loop();
                }
            }
        })
        .map_err(|e| failed(&e))?;
        let (tid, stopping) = (spinner.tid(), stop.clone());
        let watcher = spawn(spec("posix/watcher", 99)?, move || {
            watch(tid, budget, schedule, &stopping)
        })
        .map_err(|e| failed(&e))?;
        Ok(Self { spinner, watcher })
    }

    /// Waits for the end; the overruns in nanoseconds of CPU time.
    pub(super) fn finish(self) -> Result<Vec<i64>, Failure> {
        self.spinner
            .join()
            .map_err(|_| failed(&"its spinner panicked"))?;
        let samples = self
            .watcher
            .join()
            .map_err(|_| failed(&"its watcher panicked"))?;
        samples.map_err(|e| failed(&e))
    }
}

fn failed(e: &dyn Display) -> Failure {
    Failure::refused(format!("POSIX timer baseline: {e}"))
}

/// One shot after the other in every window.
fn watch(tid: Tid, budget: Nanos, schedule: Schedule, stop: &Stop) -> std::io::Result<Vec<i64>> {
    let timer = CpuTimer::new(tid)?;
    let cpu = clock::ThreadCpuClock::of(tid);
    let mut samples = Vec::with_capacity(4096);
    let mut phase = 0;
    for window in schedule.windows() {
        clock::sleep_until(window.start);
        while !stop.is_triggered() {
            // Budgets of whole ticks would always end in the same place between two ticks.
            phase = (phase + PHASE_STEP) % MAX_TICK;
            let Some(armed) = cpu.read().map(|c| c.saturating_add(budget + phase)) else {
                return Ok(samples); // the spinner has ended
            };
            timer.arm(armed)?;
            let left = window.end.saturating_sub(clock::monotonic());
            // A shot that does not fit any more would expire in the next window: leave it out.
            if left < budget + phase + MAX_TICK || !timer.wait(left) {
                break;
            }
            let used = cpu.read().unwrap_or(armed);
            samples.push(i64::try_from(used.saturating_sub(armed)).unwrap_or(i64::MAX));
        }
        timer.arm(Nanos::MAX / 2)?;
    }
    Ok(samples)
}
