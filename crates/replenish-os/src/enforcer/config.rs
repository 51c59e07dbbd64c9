//! The modes, sizes, refusals and counters of an enforcer.

use crate::Nanos;
use crate::Tid;
use crate::backend::{self, OsError};
use core::fmt;
use sporadic::{Server, Tuning};

/// The end of time, in the place of no time at all.
pub(super) const NEVER: Nanos = Nanos::MAX;

/// The most pending replenishments of one budget on this system.
pub const MAX_REPL: usize = backend::config::MAX_REPL;

/// The server type that is enforced here.
pub(super) type AnyServer = Server<MAX_REPL>;

/// The mode that holds a budget. Reported per worker, never changed silently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Enforcement {
    /// An enforcer thread on the worker's own CPU: overrun of a few microseconds.
    SameCpu,
    /// An enforcer that may run on another CPU, for workers that are not pinned: the overrun
    /// grows by an inter-processor interrupt (about 40 µs in a virtual machine, literature).
    OtherCpu,
    /// Without privilege to change priorities, a callback that finds its budget used up waits for
    /// the next replenishment before it starts. A running callback is never interrupted; its CPU
    /// time beyond the budget is a debt to later callbacks.
    Deferred,
}

impl fmt::Display for Enforcement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::SameCpu => "enforced on its CPU",
            Self::OtherCpu => "enforced from any CPU",
            Self::Deferred => "held at callback boundaries only",
        })
    }
}

/// The settings of an enforcer.
#[derive(Clone, Debug)]
pub struct EnforcerConfig {
    /// The CPU of the enforcer and of the workers it supervises; `None`: neither is pinned.
    pub cpu: Option<usize>,
    /// FIFO priority, 1..=99; must be above every worker's and the dispatcher's.
    pub priority: u8,
    /// The most workers that can be enrolled, 1..=1024. All memory is set up with this number.
    pub capacity: usize,
    /// The constants of judgement.
    pub tuning: Tuning,
    /// Whether to record context switches, so that blocking inside callbacks is seen exactly. If
    /// the kernel refuses, consumption counts as late as it can have been: budget comes back later.
    pub switch_log: bool,
    /// Whether the program stays in memory ([`memory::keep_program`](crate::memory::keep_program)),
    /// so that the enforcer never waits for a disk. A refusal:
    /// [`Enforcer::memory_refused`](crate::Enforcer::memory_refused).
    pub keep_memory: bool,
}

impl EnforcerConfig {
    /// The defaults for workers pinned to `cpu`: priority 99, room for 64 workers (8 on a
    /// microcontroller).
    #[must_use]
    pub fn on_cpu(cpu: usize) -> Self {
        Self {
            cpu: Some(cpu),
            ..Self::unpinned()
        }
    }

    /// The defaults for workers that are not pinned.
    #[must_use]
    pub fn unpinned() -> Self {
        Self {
            cpu: None,
            priority: 99,
            capacity: backend::config::ENFORCER_CAPACITY,
            tuning: Tuning::LINUX,
            switch_log: true,
            keep_memory: true,
        }
    }
}

/// Reason why a thread could not be enrolled.
#[derive(Debug)]
#[non_exhaustive]
pub enum EnrollError {
    /// Every place is taken: [`EnforcerConfig::capacity`].
    Full {
        /// The configured number of places.
        capacity: usize,
    },
    /// The worker's priority is not below the enforcer's.
    PriorityTooHigh {
        /// The worker's FIFO priority.
        worker: u8,
        /// The enforcer's FIFO priority.
        enforcer: u8,
    },
    /// The budget's parameters do not fit this system.
    Params(sporadic::ParamError),
    /// The kernel refused something at set-up.
    Os(OsError),
}

impl fmt::Display for EnrollError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Full { capacity } => {
                write!(
                    f,
                    "the enforcer has room for {capacity} budgeted workers and all are taken"
                )
            }
            Self::PriorityTooHigh { worker, enforcer } => write!(
                f,
                "priority {worker} of a budgeted worker must be below the enforcer's, {enforcer}"
            ),
            Self::Params(e) => e.fmt(f),
            Self::Os(e) => write!(f, "enrolling a worker: {e}"),
        }
    }
}

impl core::error::Error for EnrollError {}

/// Counters of one enforcer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EnforcerStats {
    /// Number of times that the timer fired.
    pub wakes: u64,
    /// Wakes that found nothing to decide: the price of the lazy timer.
    pub idle_wakes: u64,
    /// Level changes carried out.
    pub changes: u64,
    /// Level changes the kernel refused (for instance because a privilege was taken away).
    pub refused: u64,
    /// Number of faults that the watchdog has reported, see [`Fault`]; Linux only.
    pub faults: u64,
    /// CPU time of the enforcer thread in nanoseconds.
    pub cpu: Nanos,
}

/// Something that keeps budgets from being held as they should, found by the watchdog while the
/// threads run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Fault {
    /// The enforcer's thread has ended. All of its workers were lowered and stay so.
    Ended,
    /// The enforcer did not look after its workers in time: something keeps it from its CPU. The
    /// watchdog does it in its place, less often.
    Silent {
        /// Its delay in nanoseconds when the watchdog noticed it.
        late: Nanos,
    },
    /// The enforcer had another priority or another CPU than it was given. The watchdog gives them
    /// back, as far as the kernel lets it; a CPU that is offline cannot be given.
    Displaced,
    /// A worker ran with a policy that its enforcer did not give it. It has the right one again.
    ForeignPolicy {
        /// The worker's thread.
        thread: Tid,
    },
    /// The kernel refuses to raise a worker: a privilege was given up after the start. The worker
    /// stays low; its budget is not in force.
    Refused {
        /// The worker's thread.
        thread: Tid,
    },
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ended => f.write_str(
                "the enforcer has ended: its workers were lowered and get no budget any more",
            ),
            Self::Silent { late } => {
                let ms = late / 1_000_000;
                write!(
                    f,
                    "the enforcer is {ms} ms late: something keeps it from its CPU; budgets are \
                     held by the watchdog meanwhile"
                )
            }
            Self::Displaced => f.write_str(
                "the enforcer had lost its priority or its CPU (is the CPU offline?): restored if \
                 the kernel allows",
            ),
            Self::ForeignPolicy { thread } => write!(
                f,
                "thread {thread} changed its scheduling policy: restored, budgets hold"
            ),
            Self::Refused { thread } => write!(
                f,
                "the kernel refuses to raise thread {thread}: its budget is not in force, it runs \
                 at its low priority (CAP_SYS_NICE was given up, and RLIMIT_RTPRIO is too low)"
            ),
        }
    }
}
