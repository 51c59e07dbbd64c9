//! The parameters of a budget server, validated once, and the errors that say what is wrong.

use crate::Nanos;
use core::fmt;

/// The place of a thread that has no budget left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Low {
    /// The thread goes on at this lower priority, uncharged (`sched_ss_low_priority` of POSIX). The
    /// meaning of 0 is up to the operating system, e.g. the time-sharing class.
    Background(u8),
    /// The thread does not run until its budget is replenished: full temporal isolation.
    Suspend,
}

/// The parameters of one budget server. Holds `P >= 1`, `L < P`, `T >= B > 0` and `N >= 1`.
///
/// Names as in POSIX `struct sched_param` (`sched_ss_*`), XSH 2.8.4.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Params {
    priority: u8,
    low: Low,
    budget: Nanos,
    period: Nanos,
    max_repl: u16,
}

impl Params {
    /// Checks and stores the parameters.
    ///
    /// - `priority`: P, the priority while budget is available, 1 to 255 (larger is more urgent;
    ///   the operating system may allow less).
    /// - `low`: what happens without budget; a background priority L must be below P.
    /// - `budget`: B in nanoseconds, 1 to `period`.
    /// - `period`: T, the replenishment period in nanoseconds, at least 1.
    /// - `max_repl`: N, how many replenishments may be pending at once, at least 1. The capacity
    ///   of a server is its upper limit, checked where the server is made.
    ///
    /// # Errors
    /// The first parameter out of its range, by name, with the range.
    pub const fn new(
        priority: u8,
        low: Low,
        budget: Nanos,
        period: Nanos,
        max_repl: u16,
    ) -> Result<Self, ParamError> {
        if priority == 0 {
            return Err(ParamError::Priority { value: priority });
        }
        if let Low::Background(value) = low
            && value >= priority
        {
            return Err(ParamError::LowPriority { value, priority });
        }
        if period == 0 {
            return Err(ParamError::Period { value: period });
        }
        if budget == 0 || budget > period {
            return Err(ParamError::Budget {
                value: budget,
                period,
            });
        }
        if max_repl == 0 {
            return Err(ParamError::MaxRepl {
                value: max_repl,
                capacity: u16::MAX,
            });
        }
        Ok(Self {
            priority,
            low,
            budget,
            period,
            max_repl,
        })
    }

    /// P, the priority while budget is available.
    pub const fn priority(&self) -> u8 {
        self.priority
    }

    /// The thread's place while no budget is available.
    pub const fn low(&self) -> Low {
        self.low
    }

    /// B in nanoseconds, 1 to [`period`](Self::period).
    pub const fn budget(&self) -> Nanos {
        self.budget
    }

    /// T in nanoseconds, at least [`budget`](Self::budget).
    pub const fn period(&self) -> Nanos {
        self.period
    }

    /// N, the largest number of pending replenishments, at least 1.
    pub const fn max_repl(&self) -> u16 {
        self.max_repl
    }

    /// Whether a server with room for `capacity` pending replenishments can hold these parameters.
    ///
    /// # Errors
    /// [`ParamError::MaxRepl`] if `max_repl` is above `capacity`.
    pub const fn check_capacity(&self, capacity: usize) -> Result<(), ParamError> {
        if self.max_repl as usize > capacity {
            // A capacity above u16::MAX never gets here, so the cast keeps its value.
            return Err(ParamError::MaxRepl {
                value: self.max_repl,
                capacity: capacity as u16,
            });
        }
        Ok(())
    }

    /// The most pending replenishments of a server with room for `capacity`.
    pub(crate) fn limit(&self, capacity: usize) -> usize {
        usize::from(self.max_repl).min(capacity)
    }
}

/// A parameter out of its range. The message names the field, its value and what is allowed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ParamError {
    /// P is 0.
    Priority {
        /// The refused priority.
        value: u8,
    },
    /// L is not below P.
    LowPriority {
        /// The refused background priority.
        value: u8,
        /// P, which it must be below.
        priority: u8,
    },
    /// T is 0.
    Period {
        /// The refused period in nanoseconds.
        value: Nanos,
    },
    /// B is 0 or above T.
    Budget {
        /// The refused budget in nanoseconds.
        value: Nanos,
        /// T in nanoseconds, the upper limit.
        period: Nanos,
    },
    /// N is 0 or above the capacity of the server.
    MaxRepl {
        /// The refused number of replenishments.
        value: u16,
        /// The upper limit.
        capacity: u16,
    },
}

impl fmt::Display for ParamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Priority { value } => {
                write!(f, "priority {value} is out of range: allowed 1 to 255")
            }
            Self::LowPriority { value, priority } => write!(
                f,
                "low priority {value} is out of range: allowed 0 to {} (below priority {priority})",
                priority.saturating_sub(1)
            ),
            Self::Period { value } => {
                write!(
                    f,
                    "period {value} ns is out of range: allowed 1 to {} ns",
                    Nanos::MAX
                )
            }
            Self::Budget { value, period } => write!(
                f,
                "budget {value} ns is out of range: allowed 1 to {period} ns (the period)"
            ),
            Self::MaxRepl { value, capacity } => write!(
                f,
                "max_repl {value} is out of range: allowed 1 to {capacity} (pending replenishments)"
            ),
        }
    }
}

impl core::error::Error for ParamError {}
