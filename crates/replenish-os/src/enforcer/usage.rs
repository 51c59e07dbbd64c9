//! The figures that readers of an account see.

use crate::Nanos;

/// A worker's use of its budget so far; times in nanoseconds of CPU time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// CPU time at the high priority (all of it for a worker without a budget).
    pub cpu_high: Nanos,
    /// CPU time at the background priority.
    pub cpu_low: Nanos,
    /// CPU time left in the budget at this moment (0 without a budget).
    pub available: Nanos,
    /// Whether the worker is at its background priority (or suspended, or deferred) now.
    pub low: bool,
    /// Number of times that the budget ran out while the worker ran.
    pub exhaustions: u64,
    /// Number of times that a replenishment raised the worker.
    pub replenishments: u64,
    /// Stretches of blocking inside callbacks that were seen and accounted.
    pub blocked_inside: u64,
}
