//! The result of a run: counts, response times, CPU times, and the trace.

use crate::{LockId, Nanos, ThreadId};
use sporadic::Level;

/// The result of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outcome {
    /// Length of the run, in ns.
    pub horizon: Nanos,
    /// Outcomes of the threads, in the order of the system.
    pub threads: Vec<ThreadOutcome>,
    /// Time each CPU spent without a thread and without an interrupt, in ns.
    pub idle: Vec<Nanos>,
    /// Time each CPU spent on release interrupts and the enforcer, in ns.
    pub overhead: Vec<Nanos>,
    /// The events, in order; empty unless asked for.
    pub trace: Vec<Event>,
}

/// The result of one thread. Jobs that had not ended count as released only.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ThreadOutcome {
    /// Releases, those that were lost included.
    pub released: u64,
    /// Releases lost because the queue was full.
    pub dropped: u64,
    /// Jobs that came to their end.
    pub completed: u64,
    /// From release to end of each job that ended, in order, in ns.
    pub responses: Vec<Nanos>,
    /// Jobs that ended later than their deadline.
    pub misses: u64,
    /// CPU time at the high priority (all of it, without a budget), in ns.
    pub cpu_high: Nanos,
    /// CPU time without budget, in ns.
    pub cpu_low: Nanos,
    /// Number of times that the budget ran out (the throttle acted).
    pub exhaustions: u64,
    /// Number of times that the thread was raised again.
    pub replenishments: u64,
    /// Number of times that it lost a CPU to a more urgent thread while it could have gone on.
    pub preemptions: u64,
    /// The largest CPU time consumed beyond a budget at one exhaustion, in ns.
    pub worst_overrun: Nanos,
    /// Number of times that the enforcer looked at it.
    pub checks: u64,
}

impl ThreadOutcome {
    /// CPU time in all, in ns.
    pub fn cpu(&self) -> Nanos {
        self.cpu_high + self.cpu_low
    }

    /// The longest response, in ns; `None` if no job ended.
    pub fn worst(&self) -> Option<Nanos> {
        self.responses.iter().copied().max()
    }
}

/// An entry of the trace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// When, in ns.
    pub time: Nanos,
    /// Whom it concerns.
    pub thread: ThreadId,
    /// The kind of event.
    pub what: What,
}

/// An event of a thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// A release arrived.
    Release,
    /// A release was lost.
    Drop,
    /// A job began.
    Start,
    /// A job ended.
    Complete {
        /// From its release, in ns.
        response: Nanos,
    },
    /// The thread got a CPU.
    Run {
        /// The CPU.
        cpu: usize,
    },
    /// The thread lost its CPU but could go on.
    Preempt {
        /// The CPU.
        cpu: usize,
    },
    /// The thread gave its CPU up, since it waits or must not run.
    Yield {
        /// The CPU.
        cpu: usize,
    },
    /// CPU time left in its budget, in ns. Between two entries it falls evenly while the thread
    /// runs, and stays while it does not; a jump is two entries at one time.
    Budget {
        /// The amount.
        left: Nanos,
    },
    /// The thread blocked inside a job.
    Block,
    /// The thread left a wait, in or between jobs.
    Wake,
    /// The thread waits for a lock.
    LockWait {
        /// The lock.
        lock: LockId,
    },
    /// The thread holds a lock now.
    Locked {
        /// The lock.
        lock: LockId,
    },
    /// The thread released a lock.
    Unlocked {
        /// The lock.
        lock: LockId,
    },
    /// The thread's budget server changed its level.
    Level(Level),
    /// `SCHED_DEADLINE` throttled it.
    Throttle,
    /// `SCHED_DEADLINE` gave it runtime again.
    Unthrottle,
}
