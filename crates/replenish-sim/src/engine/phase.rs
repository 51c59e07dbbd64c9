//! A thread's activity at the moment, and its urgency.

use crate::LockId;

/// Urgency of a thread; larger is more urgent. 0 is the time-sharing class, up to 255 the FIFO
/// priorities, above that `SCHED_DEADLINE`, earlier deadlines larger.
pub(super) type Rank = u64;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    /// Between jobs.
    Idle,
    /// Could run.
    Ready,
    /// In a `Block` step.
    Blocked,
    /// Waits for a lock.
    LockWait(LockId),
}
