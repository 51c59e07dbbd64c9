//! CPU budgets, as users state them and as everything below them takes them.

use crate::units::WholeUnits;
use crate::{Low, Nanos};
use core::fmt;
use core::time::Duration;

/// CPU time in every period at a thread's own priority.
///
/// Beyond its budget the thread runs in the background, or not at all. Ranges are checked where
/// the budget gets its server ([`Params::new`](crate::Params::new)): 0 < amount <= period.
///
/// ```
/// use sporadic::Budget;
/// use std::time::Duration;
/// let budget = Budget::of(Duration::from_millis(30)).every(Duration::from_millis(100));
/// assert_eq!(budget.to_string(), "30 ms every 100 ms");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Budget {
    /// The CPU time in nanoseconds.
    pub amount: Nanos,
    /// The period in nanoseconds.
    pub period: Nanos,
    /// Whether the thread waits for its replenishment once the budget is spent.
    pub suspend: bool,
}

/// The first half of a [`Budget`]: an amount that still needs its period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use = "a budget needs a period: .every(…)"]
pub struct Amount(Nanos);

impl Budget {
    /// `amount` of CPU time; the period follows.
    pub const fn of(amount: Duration) -> Amount {
        Amount(nanos(amount))
    }

    /// The same budget; once it is spent, the thread waits for its replenishment.
    #[must_use]
    pub const fn suspend(self) -> Self {
        Self {
            suspend: true,
            ..self
        }
    }

    /// The level without budget of a thread at `priority`: suspended, or in the background at
    /// `wanted` or just below `priority`, whichever is less urgent. `None`: there is no real-time
    /// priority below.
    #[must_use]
    pub fn low(&self, priority: u8, wanted: u8) -> Option<Low> {
        if self.suspend {
            return Some(Low::Suspend);
        }
        let below = priority.checked_sub(1).filter(|below| *below > 0)?;
        Some(Low::Background(wanted.min(below)))
    }
}

impl Amount {
    /// The budget of this amount in every `period`.
    #[must_use]
    pub const fn every(self, period: Duration) -> Budget {
        Budget {
            amount: self.0,
            period: nanos(period),
            suspend: false,
        }
    }
}

/// A duration in nanoseconds; 584 years where it is longer.
const fn nanos(span: Duration) -> Nanos {
    let whole = span.as_secs().saturating_mul(1_000_000_000);
    whole.saturating_add(span.subsec_nanos() as Nanos)
}

impl fmt::Display for Budget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (amount, period) = (WholeUnits(self.amount), WholeUnits(self.period));
        write!(f, "{amount} every {period}")?;
        if self.suspend {
            f.write_str(", then suspended")?;
        }
        Ok(())
    }
}
