//! CPU budgets as users say them.

use crate::executor::planning::Guarantee;
use core::fmt;
use core::time::Duration;

/// So much CPU time in every period, at the worker's priority; beyond it the worker runs in the
/// background, or not at all.
///
/// ```
/// use replenish::Budget;
/// use std::time::Duration;
/// let budget = Budget::of(Duration::from_millis(30)).every(Duration::from_millis(100));
/// assert_eq!(budget.to_string(), "30ms every 100ms");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Budget {
    pub(crate) amount: Duration,
    pub(crate) period: Duration,
    pub(crate) suspend: bool,
}

/// The first half of a [`Budget`]: an amount that still needs its period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use = "a budget needs a period: .every(…)"]
pub struct Amount(Duration);

impl Budget {
    /// `amount` of CPU time. Ranges are checked when the executor starts:
    /// 0 < amount ≤ period.
    pub const fn of(amount: Duration) -> Amount {
        Amount(amount)
    }

    /// An exhausted worker waits for its replenishment instead of running in the background.
    #[must_use]
    pub const fn suspend(self) -> Self {
        Self {
            suspend: true,
            ..self
        }
    }

    /// The same without what a plain budget cannot say.
    pub(crate) fn from_guarantee(guarantee: &Guarantee) -> Self {
        Self {
            amount: Duration::from_nanos(guarantee.amount()),
            period: Duration::from_nanos(guarantee.period()),
            suspend: guarantee.suspends(),
        }
    }

    /// The CPU time per period.
    #[must_use]
    pub const fn amount(&self) -> Duration {
        self.amount
    }

    /// The period.
    #[must_use]
    pub const fn period(&self) -> Duration {
        self.period
    }
}

impl Amount {
    /// The budget of this amount in every `period`.
    #[must_use]
    pub const fn every(self, period: Duration) -> Budget {
        Budget {
            amount: self.0,
            period,
            suspend: false,
        }
    }
}

impl fmt::Display for Budget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} every {:?}", self.amount, self.period)?;
        if self.suspend {
            f.write_str(", then suspended")?;
        }
        Ok(())
    }
}
