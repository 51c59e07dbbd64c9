//! Helpers of the real-time trials: one CPU for all of them, threads that place themselves.
#![allow(dead_code, reason = "every target uses a part of it")]

#[cfg(not(nuttx_host))]
use replenish_os::{CpuSet, affinity, set_affinity};
use replenish_os::{SchedClass, clock, current_tid, set_priority};
use std::sync::atomic::{AtomicBool, Ordering};

/// One millisecond.
pub(crate) const MS: u64 = 1_000_000;

/// The CPU real-time trials run on: the last one this process may use.
#[cfg(not(nuttx_host))]
pub(crate) fn cpu() -> usize {
    affinity(current_tid()).unwrap().iter().last().unwrap()
}

/// The script that starts the process pins it to a real CPU, which has the number 0 here.
#[cfg(nuttx_host)]
pub(crate) fn cpu() -> usize {
    0
}

/// Pins the calling thread to CPU `cpu`.
pub(crate) fn pin(cpu: usize) {
    #[cfg(not(nuttx_host))]
    set_affinity(current_tid(), &CpuSet::one(cpu)).unwrap();
    #[cfg(nuttx_host)]
    assert_eq!(cpu, 0);
}

/// Makes the calling thread FIFO at `priority` and pins it to `cpu`. Priority first: in the
/// time-sharing class it might never run where it is pinned.
pub(crate) fn become_fifo(cpu: usize, priority: u8) {
    set_priority(current_tid(), SchedClass::Fifo(priority)).unwrap();
    pin(cpu);
}

/// Burns CPU until `stop` is set or 2 s of its own CPU time are gone.
pub(crate) fn spin(stop: &AtomicBool) {
    let end = clock::thread_cpu() + 2_000 * MS;
    while !stop.load(Ordering::Relaxed) && clock::thread_cpu() < end {
        std::hint::spin_loop();
    }
}

/// Burns `ns` of the calling thread's CPU time.
pub(crate) fn burn(ns: u64) {
    let end = clock::thread_cpu() + ns;
    while clock::thread_cpu() < end {
        std::hint::spin_loop();
    }
}
