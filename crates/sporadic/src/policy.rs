//! A thread's request to the scheduler, checked before the kernel sees it.

use crate::units::WholeUnits;
use crate::{Low, Nanos, ParamError, Params};
use core::fmt;

/// The largest real-time priority of Linux and of most POSIX systems; the smallest is 1.
pub const MAX_PRIORITY: u8 = 99;

/// The smallest `SCHED_DEADLINE` runtime Linux takes, in nanoseconds.
pub const MIN_RUNTIME: Nanos = 1024;

/// A scheduling policy with its parameters.
///
/// The constructors check ranges; a value built by hand is checked by [`validate`](Self::validate)
/// at the latest when a thread is spawned with it. Priorities go from 1 (lowest) to 99.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Policy {
    /// `SCHED_OTHER`: the fair, time-sharing class. No guarantee.
    #[default]
    Other,
    /// `SCHED_FIFO`: runs until it blocks or something higher wants the CPU.
    Fifo {
        /// 1 to 99.
        priority: u8,
    },
    /// `SCHED_RR`: as FIFO, but equals take turns.
    RoundRobin {
        /// 1 to 99.
        priority: u8,
    },
    /// A sporadic server: FIFO at the priority of the parameters for the budget in every period.
    /// The thread is given that FIFO priority; the budget is the enforcer's work.
    Sporadic(Params),
    /// `SCHED_SPORADIC` of the system itself, where it has one (`NuttX`), refused elsewhere. For
    /// comparison: what it grants is not what it is asked for (`docs/nuttx-history.md`). No
    /// enforcer looks after such a thread.
    KernelSporadic(Params),
    /// `SCHED_DEADLINE`: the kernel's constant-bandwidth server, a hard reservation. It excludes
    /// pinning to a CPU, and Linux enforces it with the precision of the scheduler tick.
    Deadline {
        /// CPU time guaranteed in every period, in nanoseconds; 1024 to `deadline`.
        runtime: Nanos,
        /// Deadline for the runtime, in nanoseconds after the release; up to `period`.
        deadline: Nanos,
        /// The period in nanoseconds. By default Linux takes 100 us to 4.19 s
        /// (`kernel.sched_deadline_period_{min,max}_us`).
        period: Nanos,
        /// Whether the thread may use bandwidth that other reservations leave (GRUB).
        reclaim: bool,
    },
}

impl Policy {
    /// FIFO at `priority`.
    ///
    /// # Errors
    /// If `priority` is not in 1..=99.
    pub fn fifo(priority: u8) -> Result<Self, PolicyError> {
        Self::Fifo { priority }.validate()
    }

    /// Round-robin at `priority`.
    ///
    /// # Errors
    /// If `priority` is not in 1..=99.
    pub fn round_robin(priority: u8) -> Result<Self, PolicyError> {
        Self::RoundRobin { priority }.validate()
    }

    /// A sporadic server.
    ///
    /// # Errors
    /// If its priority is not in 1..=99.
    pub fn sporadic(params: Params) -> Result<Self, PolicyError> {
        Self::Sporadic(params).validate()
    }

    /// A `SCHED_DEADLINE` reservation, without reclaiming.
    ///
    /// # Errors
    /// Unless 1024 ns <= `runtime` <= `deadline` <= `period` <= `i64::MAX` ns.
    pub fn deadline(runtime: Nanos, deadline: Nanos, period: Nanos) -> Result<Self, PolicyError> {
        Self::Deadline {
            runtime,
            deadline,
            period,
            reclaim: false,
        }
        .validate()
    }

    /// The policy itself if all its parameters are in range.
    ///
    /// # Errors
    /// The first parameter that is not, with its range.
    pub fn validate(self) -> Result<Self, PolicyError> {
        self.check().map(|()| self)
    }

    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is out of its range, with the range.
    pub fn check(&self) -> Result<(), PolicyError> {
        match *self {
            Self::Other => Ok(()),
            Self::Fifo { priority } | Self::RoundRobin { priority } => check_priority(priority),
            Self::Sporadic(ref params) | Self::KernelSporadic(ref params) => {
                check_priority(params.priority())
            }
            Self::Deadline {
                runtime,
                deadline,
                period,
                ..
            } => {
                if period > i64::MAX.cast_unsigned() {
                    return Err(PolicyError::Period { value: period });
                }
                if deadline > period {
                    return Err(PolicyError::Deadline {
                        value: deadline,
                        period,
                    });
                }
                if !(MIN_RUNTIME..=deadline).contains(&runtime) {
                    return Err(PolicyError::Runtime {
                        value: runtime,
                        deadline,
                    });
                }
                Ok(())
            }
        }
    }

    /// The parameters of its budget server; `None` for policies without a budget.
    #[must_use]
    pub const fn params(&self) -> Option<&Params> {
        match self {
            Self::Sporadic(params) | Self::KernelSporadic(params) => Some(params),
            _ => None,
        }
    }

    /// The period of its budget or reservation, in nanoseconds; `None` for policies without one.
    #[must_use]
    pub const fn period(&self) -> Option<Nanos> {
        match self {
            Self::Sporadic(params) | Self::KernelSporadic(params) => Some(params.period()),
            Self::Deadline { period, .. } => Some(*period),
            _ => None,
        }
    }

    /// The real-time priority the thread starts with; `None` for policies without one.
    #[must_use]
    pub const fn priority(&self) -> Option<u8> {
        match *self {
            Self::Fifo { priority } | Self::RoundRobin { priority } => Some(priority),
            Self::Sporadic(ref params) | Self::KernelSporadic(ref params) => {
                Some(params.priority())
            }
            Self::Other | Self::Deadline { .. } => None,
        }
    }
}

const fn check_priority(value: u8) -> Result<(), PolicyError> {
    if value >= 1 && value <= MAX_PRIORITY {
        Ok(())
    } else {
        Err(PolicyError::Priority { value })
    }
}

/// `FIFO 60`, `SPORADIC 60/6 (30 ms every 100 ms)`, `DEADLINE 3 ms/10 ms/10 ms`, ...
impl fmt::Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Other => f.write_str("OTHER"),
            Self::Fifo { priority } => write!(f, "FIFO {priority}"),
            Self::RoundRobin { priority } => write!(f, "RR {priority}"),
            Self::Sporadic(params) | Self::KernelSporadic(params) => {
                let kernel = matches!(self, Self::KernelSporadic(_));
                let class = if kernel { "SCHED_SPORADIC" } else { "SPORADIC" };
                write!(f, "{class} {}/", params.priority())?;
                match params.low() {
                    Low::Background(low) => write!(f, "{low}")?,
                    Low::Suspend => f.write_str("suspend")?,
                }
                let (budget, period) = (WholeUnits(params.budget()), WholeUnits(params.period()));
                write!(f, " ({budget} every {period})")
            }
            Self::Deadline {
                runtime,
                deadline,
                period,
                reclaim,
            } => {
                let (runtime, deadline, period) = (
                    WholeUnits(runtime),
                    WholeUnits(deadline),
                    WholeUnits(period),
                );
                let reclaim = if reclaim { ", reclaiming" } else { "" };
                write!(f, "DEADLINE {runtime}/{deadline}/{period}{reclaim}")
            }
        }
    }
}

/// A policy parameter out of its range. The message names the field, its value and the range.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum PolicyError {
    /// A real-time priority outside 1..=99.
    Priority {
        /// The refused priority.
        value: u8,
    },
    /// A runtime below 1024 ns or above the deadline.
    Runtime {
        /// The refused runtime in nanoseconds.
        value: Nanos,
        /// The deadline in nanoseconds.
        deadline: Nanos,
    },
    /// A deadline above the period.
    Deadline {
        /// The refused deadline in nanoseconds.
        value: Nanos,
        /// The period in nanoseconds.
        period: Nanos,
    },
    /// A period above `i64::MAX` nanoseconds.
    Period {
        /// The refused period in nanoseconds.
        value: Nanos,
    },
    /// A parameter of a sporadic server.
    Sporadic(ParamError),
}

impl From<ParamError> for PolicyError {
    fn from(e: ParamError) -> Self {
        Self::Sporadic(e)
    }
}

impl fmt::Display for PolicyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Priority { value } => {
                write!(
                    f,
                    "priority {value} is out of range: allowed 1 to {MAX_PRIORITY}"
                )
            }
            Self::Runtime { value, deadline } => write!(
                f,
                "runtime {value} ns is out of range: allowed {MIN_RUNTIME} to {deadline} ns (the deadline)"
            ),
            Self::Deadline { value, period } => write!(
                f,
                "deadline {value} ns is out of range: allowed {MIN_RUNTIME} to {period} ns (the period)"
            ),
            Self::Period { value } => {
                write!(
                    f,
                    "period {value} ns is out of range: allowed up to {} ns",
                    i64::MAX
                )
            }
            Self::Sporadic(ref e) => e.fmt(f),
        }
    }
}

impl core::error::Error for PolicyError {}

#[cfg(test)]
#[path = "policy_tests.rs"]
mod tests;
