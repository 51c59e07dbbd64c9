//! The modes, sizes, refusals and counters of an enforcer.

use crate::Nanos;
use crate::backend::{self, OsError};
use core::fmt;
use sporadic::{Server, Tuning};

/// The end of time, in the place of no time at all.
pub(super) const NEVER: Nanos = Nanos::MAX;

/// How many pending replenishments a budget may have at most on this system.
pub const MAX_REPL: usize = backend::config::MAX_REPL;

/// The server type that is enforced here.
pub(super) type AnyServer = Server<MAX_REPL>;

/// Which mode of the ladder holds budgets. Reported per worker, never changed silently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Enforcement {
    /// An enforcer thread on the worker's own CPU: overrun of a few microseconds.
    SameCpu,
    /// An enforcer that may run on another CPU, for workers that are not pinned: the overrun
    /// grows by an inter-processor interrupt (about 40 µs in a virtual machine, literature).
    OtherCpu,
    /// No privilege to change priorities: a callback that finds its budget used up waits for the
    /// next replenishment before it starts. A callback that runs is never interrupted; what it
    /// takes too much is a debt to later callbacks.
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

/// What an enforcer is made with.
#[derive(Clone, Debug)]
pub struct EnforcerConfig {
    /// The CPU of the enforcer and of the workers it supervises; `None`: neither is pinned.
    pub cpu: Option<usize>,
    /// FIFO priority, 1..=99; must be above every worker's and the dispatcher's.
    pub priority: u8,
    /// How many workers can be enrolled, 1..=1024. All memory is set up with this number.
    pub capacity: usize,
    /// The constants of judgement.
    pub tuning: Tuning,
    /// Whether to record context switches, so that blocking inside callbacks is seen exactly.
    /// Where the kernel refuses, the voluntary-switch counter stands in (less exact, safe).
    pub switch_log: bool,
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
        }
    }
}

/// Why a thread could not be enrolled.
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
    /// How often the timer fired.
    pub wakes: u64,
    /// Wakes that found nothing to decide: the price of the lazy timer.
    pub idle_wakes: u64,
    /// Level changes carried out.
    pub changes: u64,
    /// Level changes the kernel refused (for instance because a privilege was taken away).
    pub refused: u64,
    /// CPU time of the enforcer thread in nanoseconds.
    pub cpu: Nanos,
}
