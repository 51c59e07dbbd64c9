//! Whether the machine stood still: a thread above everything else on the CPU that sleeps for a
//! millisecond again and again, and notes how late it wakes at worst.
//!
//! It sees what no budget can help against: a hypervisor that takes the CPU away, a kernel that
//! does not let go of it. It knows nothing of the workers.

use crate::load::{MS, Nanos};
use replenish_cli::machine;
use replenish_cli::outcome::Failure;
use replenish_os::{Thread, ThreadSpec, clock, spawn};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Length of each sleep, in ns.
const INTERVAL: Nanos = MS;

/// A probe that runs.
pub(crate) struct Probe {
    stop: Arc<AtomicBool>,
    thread: Thread<Nanos>,
}

/// Starts a probe on this CPU. Without real-time priority it sees every delay of an ordinary
/// thread.
pub(crate) fn start(cpu: usize) -> Result<Probe, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = Arc::clone(&stop);
    let spec = ThreadSpec::new("probe")
        .policy(machine::fifo_or_other(99))
        .cpu(cpu);
    let thread = spawn(spec, move || {
        let mut worst = 0;
        while !stopped.load(Ordering::Relaxed) {
            let due = clock::monotonic() + INTERVAL;
            clock::sleep_until(due);
            worst = worst.max(clock::monotonic().saturating_sub(due));
        }
        worst
    })
    .map_err(Failure::refused)?;
    Ok(Probe { stop, thread })
}

impl Probe {
    /// The worst lateness, in ns.
    pub(crate) fn stop(self) -> Nanos {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap_or(Nanos::MAX)
    }
}
