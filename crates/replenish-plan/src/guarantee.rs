//! The need of a worker, in its user's words.

use crate::Nanos;
use crate::guarantee_error::GuaranteeError;
use crate::span::Exact;
use sporadic::Budget;
use std::fmt;
use std::time::Duration;

/// CPU time that a worker is to get, whatever else runs.
///
/// Two ways to say it:
/// - an amount per period: `Guarantee::of(ms(30)).every(ms(100))`. The worker gets 30 ms of CPU
///   time in every 100 ms, and not more at its priority;
/// - a rate: `Guarantee::at(50.0).taking(ms(3))`. A callback of at most 3 ms runs 50 times a second
///   and ends within its deadline. The planner adds what enforcing costs.
///
/// Ranges are checked when a plan is made: `0 < minimum <= amount <= desired <= deadline <=
/// period`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Guarantee {
    pub(crate) budget: Budget,
    pub(crate) per_job: bool,
    /// The bits of a rate in Hz that has no period, for its error; else 0.
    pub(crate) refused_rate: u64,
    pub(crate) deadline: Option<Nanos>,
    pub(crate) importance: u8,
    pub(crate) minimum: Option<Nanos>,
    pub(crate) desired: Option<Nanos>,
}

/// An amount that still needs its period.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use = "a guarantee needs a period: .every(…)"]
pub struct OfAmount(Nanos);

/// A rate that still needs an execution time.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use = "a rate needs an execution time: .taking(…)"]
pub struct OfRate(f64);

impl Guarantee {
    /// The [`importance`](Self::importance) where none is given.
    pub const IMPORTANCE: u8 = 100;

    /// `amount` of CPU time; the period follows.
    pub fn of(amount: Duration) -> OfAmount {
        OfAmount(nanos(amount))
    }

    /// A rate of callbacks, in Hz; their execution time follows. A rate that is not
    /// positive and finite counts as out of range when the plan is made.
    pub fn at(hertz: f64) -> OfRate {
        OfRate(hertz)
    }

    /// Sets the deadline after a release, by which the CPU time must have been given; 0 < deadline
    /// <= period. Default: the period.
    #[must_use]
    pub fn deadline(mut self, deadline: Duration) -> Self {
        self.deadline = Some(nanos(deadline));
        self
    }

    /// 0 to 255, default 100. A more important worker is admitted first, gets its desired amount
    /// first, and goes first when it works beyond its budget. Importance is no priority: deadlines
    /// decide which worker preempts.
    #[must_use]
    pub fn importance(mut self, importance: u8) -> Self {
        self.importance = importance;
        self
    }

    /// Sets the least amount that the worker can live with; admission tests no more. Default: the
    /// amount.
    #[must_use]
    pub fn at_least(mut self, minimum: Duration) -> Self {
        self.minimum = Some(nanos(minimum));
        self
    }

    /// Sets the amount that the worker can make use of; it gets that if it fits. Default: the
    /// amount.
    #[must_use]
    pub fn up_to(mut self, desired: Duration) -> Self {
        self.desired = Some(nanos(desired));
        self
    }

    /// Beyond its budget it waits instead of running in the background.
    #[must_use]
    pub fn suspend(mut self) -> Self {
        self.budget.suspend = true;
        self
    }

    /// The CPU time per period (of a rate: per callback), in ns.
    #[must_use]
    pub fn amount(&self) -> Nanos {
        self.budget.amount
    }

    /// The period (of a rate: 1 / rate), in ns.
    #[must_use]
    pub fn period(&self) -> Nanos {
        self.budget.period
    }

    /// Whether it was stated as a rate.
    #[must_use]
    pub fn is_rate(&self) -> bool {
        self.per_job
    }

    /// The budget alone, without what a plain one cannot say.
    #[must_use]
    pub fn budget(&self) -> Budget {
        self.budget
    }

    /// The deadline in force, in ns.
    #[must_use]
    pub fn due_within(&self) -> Nanos {
        self.deadline.unwrap_or(self.budget.period)
    }

    /// The amount below which it is not admitted, in ns.
    #[must_use]
    pub fn minimum(&self) -> Nanos {
        self.minimum.unwrap_or(self.budget.amount)
    }

    /// The largest amount it gets, in ns.
    #[must_use]
    pub fn desired(&self) -> Nanos {
        self.desired.unwrap_or(self.budget.amount)
    }

    /// Checks every field.
    ///
    /// # Errors
    /// The first field out of its range, with the range.
    pub fn check(&self) -> Result<(), GuaranteeError> {
        let (amount, period, deadline) =
            (self.budget.amount, self.budget.period, self.due_within());
        let fields = [
            ("period", period, 1, MAX_PERIOD),
            ("deadline", deadline, 1, period),
            ("amount", amount, 1, deadline),
            ("minimum", self.minimum(), 1, amount),
            ("desired", self.desired(), amount, deadline),
        ];
        for (field, value, low, high) in fields {
            if !(low..=high).contains(&value) {
                return Err(GuaranteeError {
                    field,
                    value,
                    low,
                    high,
                    rate: self.per_job.then(|| match period {
                        0 => f64::from_bits(self.refused_rate),
                        _ => 1e9 / period as f64,
                    }),
                    deadline: self.deadline.is_some(),
                });
            }
        }
        Ok(())
    }
}

/// The longest period that can be planned with: a day. Beyond, windows of a hundred periods would
/// not fit 64 bits of nanoseconds.
pub(crate) const MAX_PERIOD: Nanos = 86_400_000_000_000;

impl OfAmount {
    /// The guarantee of this amount in every `period`.
    pub fn every(self, period: Duration) -> Guarantee {
        Guarantee::new(self.0, nanos(period), false)
    }
}

impl OfRate {
    /// The guarantee of this rate for callbacks of at most `execution` CPU time: measured, with a
    /// margin, or known.
    pub fn taking(self, execution: Duration) -> Guarantee {
        let period = period_of(self.0).unwrap_or(0);
        Guarantee {
            refused_rate: if period == 0 { self.0.to_bits() } else { 0 },
            ..Guarantee::new(nanos(execution), period, true)
        }
    }
}

impl Guarantee {
    pub(crate) fn new(amount: Nanos, period: Nanos, per_job: bool) -> Self {
        let budget = Budget {
            amount,
            period,
            suspend: false,
        };
        Self {
            per_job,
            ..budget.into()
        }
    }
}

impl From<Budget> for Guarantee {
    fn from(budget: Budget) -> Self {
        Self {
            budget,
            per_job: false,
            refused_rate: 0,
            deadline: None,
            importance: Self::IMPORTANCE,
            minimum: None,
            desired: None,
        }
    }
}

/// CPU time, and the period in which it is given: `(ms(30), ms(100))`.
impl From<(Duration, Duration)> for Guarantee {
    fn from((amount, period): (Duration, Duration)) -> Self {
        Budget::of(amount).every(period).into()
    }
}

pub(crate) fn nanos(span: Duration) -> Nanos {
    Nanos::try_from(span.as_nanos()).unwrap_or(Nanos::MAX)
}

/// The period of a rate in Hz, in ns; `None` unless it is positive, finite, and at most 1 GHz.
pub(crate) fn period_of(hertz: f64) -> Option<Nanos> {
    #[expect(clippy::cast_sign_loss, reason = "a negative one becomes 0")]
    // Rounded down, but for what the division itself rounds.
    let period = (1e9 / hertz + 0.01).floor() as Nanos;
    (hertz.is_finite() && hertz > 0.0 && period > 0).then_some(period)
}

impl fmt::Display for Guarantee {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let every = if self.per_job { "once every" } else { "every" };
        write!(
            f,
            "{} {every} {}",
            Exact(self.amount()),
            Exact(self.period())
        )?;
        if let Some(deadline) = self.deadline {
            write!(f, ", within {}", Exact(deadline))?;
        }
        Ok(())
    }
}
