//! The least supply of a reservation, and how long work takes inside it.

use crate::Nanos;
use sporadic::Params;

/// Busy periods of more jobs than this are given up.
pub(super) const MAX_JOBS: u64 = 10_000;

/// The least CPU time a reservation (corrected sporadic server) delivers to a worker that always
/// has work, in any window of a given length (SL03, LB03).
///
/// ```text
///  delivered │                          ┌──────── …
///         2B │                         ╱          the least: nothing for as long as possible,
///            │           ┌────────────┘           then B in every T
///          B │          ╱ :           :
///            │         ╱  :           :
///            └────────┘───┴───────────┴────────► window
///             blackout  B       T
/// ```
///
/// Worst case: the budget has just been used up, as late as could be, and what comes back is served
/// as late as it can be. Budget used at an activation comes back a period later and is delivered
/// within `service` of that time.
/// - If it was used in small pieces, at activations of their own, and `max_repl` was too small for
///   so many, they are merged at the latest of their times: nothing comes before that, so the
///   blackout is `T - B + service`.
/// - If they are never merged, they come as they went: `T - 2B + service`. With `service = B` (no
///   thread interferes) that is `T - B`; with `service = T` the `2 (T - B)` of the periodic
///   resource model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Supply {
    budget: Nanos,
    period: Nanos,
    service: Nanos,
    overrun: Nanos,
    merged: bool,
}

impl Supply {
    /// The supply of a reservation.
    ///
    /// - `service`: budget that is due and asked for is delivered within this time: see
    ///   [`Bounds::service`](super::Bounds::service). At least the budget.
    ///   Budget that is served later than a period after its time comes back later by as much, so a
    ///   longer `service` is a longer period.
    /// - `overrun`: by how much the budget can be overdrawn. It is paid back, so this much is
    ///   missing, once.
    /// - `slack`: how much of the budget can be put off as too little to be used, in each period.
    ///   `None` is returned if that is all of it.
    pub fn new(params: &Params, service: Nanos, overrun: Nanos, slack: Nanos) -> Option<Self> {
        let budget = params.budget().checked_sub(slack).filter(|&b| b > 0)?;
        Some(Self {
            budget,
            period: params.period().max(service),
            service: service.max(budget),
            overrun,
            merged: true,
        })
    }

    /// Says that replenishments are never merged. True for a worker that does not wait; otherwise
    /// hard to know, since pieces of budget that is waited for keep their times from period to
    /// period, so that more of them than wake-ups in a period can be pending.
    #[must_use]
    pub fn unmerged(mut self) -> Self {
        self.merged = false;
        self
    }

    /// The longest time without any delivery, in ns.
    pub fn blackout(&self) -> Nanos {
        let late = self.period + self.service - self.budget;
        if self.merged {
            late
        } else {
            late - self.budget
        }
    }

    /// The least CPU time delivered in any window of this length, in ns.
    pub fn in_window(&self, window: Nanos) -> Nanos {
        let Some(rest) = window.checked_sub(self.blackout()) else {
            return 0;
        };
        let whole = (rest / self.period).saturating_mul(self.budget);
        let part = (rest % self.period).min(self.budget);
        whole.saturating_add(part).saturating_sub(self.overrun)
    }

    /// The shortest window in which at least `cost` is delivered, in ns: how long a callback of
    /// this CPU time can take that finds no other work before it.
    pub fn window_for(&self, cost: Nanos) -> Nanos {
        if cost == 0 {
            return 0;
        }
        let cost = cost.saturating_add(self.overrun);
        let whole = (cost - 1) / self.budget;
        let part = cost - whole * self.budget;
        whole
            .saturating_mul(self.period)
            .saturating_add(self.blackout())
            .saturating_add(part)
    }

    /// From the arrival to the end of a job of `cost` every `period` with this much release
    /// `jitter`, jobs done in order; `None` if the worker can fall behind for ever, or for longer
    /// than `limit`.
    ///
    /// The busy period (Leh90) with the supply in the place of the CPU.
    pub fn response(
        &self,
        cost: Nanos,
        period: Nanos,
        jitter: Nanos,
        limit: Nanos,
    ) -> Option<Nanos> {
        let asked = u128::from(cost) * u128::from(self.period);
        if asked > u128::from(period) * u128::from(self.budget) {
            return None;
        }
        if self.least_jobs(cost, period, jitter) > u128::from(MAX_JOBS) {
            return None;
        }
        let mut worst = 0;
        for job in 0..=MAX_JOBS {
            if job == MAX_JOBS {
                return None;
            }
            let end = self.window_for(cost.checked_mul(job + 1)?);
            if end > limit {
                return None;
            }
            let arrival = job * period;
            worst = worst.max((end + jitter).saturating_sub(arrival));
            if end + jitter <= arrival + period {
                break;
            }
        }
        Some(worst)
    }

    /// The jobs of a busy period, at least.
    ///
    /// In the best case what is delivered follows `T / B` times what was asked for: n jobs end
    /// `T / B * (n * cost + overrun) + blackout - (T - B)` after the first arrival, and the period
    /// is over when that, and the jitter, is not more than `n * period`.
    fn least_jobs(&self, cost: Nanos, period: Nanos, jitter: Nanos) -> u128 {
        let wide = u128::from;
        let (budget, whole) = (wide(self.budget), wide(self.period));
        let gained = (wide(period) * budget).saturating_sub(wide(cost) * whole);
        let late = (wide(self.blackout()) + wide(jitter) + budget).saturating_sub(whole);
        let missing = late.saturating_mul(budget);
        let missing = missing.saturating_add(wide(self.overrun) * whole);
        match gained {
            0 if missing > 0 => u128::MAX,
            0 => 0,
            gained => missing / gained,
        }
    }
}
