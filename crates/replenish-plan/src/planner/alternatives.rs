//! The nearest guarantees that would fit after a refusal, each tried before it is named.

use super::assign;
use super::problem::Problem;
use super::search::search;
use crate::span::{Rounded, step};
use crate::{Guarantee, Nanos, Request, Requirement, Worker};
use sporadic::Budget;
use std::fmt;

/// A change to a request with which it is admitted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Alternative {
    /// The worker whose guarantee would change.
    pub worker: String,
    /// The amount per period that fits, in ns.
    pub amount: Nanos,
    /// The period, in ns.
    pub period: Nanos,
    /// The part of the guarantee that is new.
    pub changed: Changed,
    /// Workers that would have to be left out as well.
    pub without: Vec<String>,
}

/// The change that an [`Alternative`] makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Changed {
    /// A smaller amount.
    Amount,
    /// A longer period.
    Period,
}

impl Alternative {
    /// The request with this change.
    #[must_use]
    pub fn apply(&self, request: &Request) -> Request {
        let mut request = without(request, &self.without);
        for worker in request.workers.iter_mut().filter(|w| w.name == self.worker) {
            change(worker, self.amount, self.period);
        }
        request
    }
}

impl fmt::Display for Alternative {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (amount, period) = (Rounded(self.amount), Rounded(self.period));
        match self.changed {
            Changed::Amount => write!(f, "{amount} every {period}"),
            Changed::Period => write!(f, "a period of {period}"),
        }
    }
}

pub(super) fn without(request: &Request, names: &[String]) -> Request {
    let mut request = request.clone();
    request.workers.retain(|w| !names.contains(&w.name));
    request
}

/// Gives a worker's guarantee another amount, fixed, and another period. A deadline that was the
/// period, or does not fit the period any more, becomes the period.
fn change(worker: &mut Worker, amount: Nanos, period: Nanos) {
    if let Requirement::Guarantee(guarantee) = &mut worker.scheduling {
        *guarantee = Guarantee {
            budget: Budget {
                amount,
                period,
                ..guarantee.budget
            },
            minimum: None,
            desired: None,
            deadline: guarantee.deadline.filter(|d| *d < guarantee.period()),
            ..*guarantee
        };
    }
}

/// The longest period to try for a worker, as a multiple of its own; a power of 2.
const LONGER: u64 = 128;

/// Requests of this worker that fit: a smaller amount and a longer period, where there are such.
pub(super) fn nearest(request: &Request, worker: &str, left_out: &[String]) -> Vec<Alternative> {
    let Some(guarantee) = request.workers.iter().find(|w| w.name == worker) else {
        return Vec::new();
    };
    let Some(guarantee) = guarantee.guarantee().copied() else {
        return Vec::new();
    };
    let fit = |amount, period, changed| Alternative {
        worker: worker.into(),
        amount,
        period,
        changed,
        without: left_out.to_vec(),
    };
    let admits = |fit: &Alternative| admits(&fit.apply(request));
    // Large sets take longer to test: fewer digits then.
    let digits = if request.workers.len() > 100 { 2 } else { 3 };
    let mut found = Vec::new();

    let amount = guarantee.minimum();
    let by = step(amount, digits);
    let smaller = |n: Nanos| fit(n * by, guarantee.period(), Changed::Amount);
    if admits(&smaller(1)) {
        let good = search(1, amount.div_ceil(by).max(2), |n| admits(&smaller(n)));
        found.push(smaller(good));
    }

    let longer = |period| fit(amount, period, Changed::Period);
    let longest = guarantee.period().saturating_mul(LONGER);
    let mut good = guarantee.period();
    let reached = admits(&longer(longest)) && {
        while good < longest {
            good = good.saturating_mul(2);
            if good == longest || admits(&longer(good)) {
                break;
            }
        }
        true
    };
    if reached {
        let by = step(good, digits);
        // Downwards: what is searched for is how many steps can be taken off.
        let top = good.div_ceil(by);
        let off = search(0, top - good / 2 / by, |n| admits(&longer((top - n) * by)));
        let good = top - off;
        let best = longer(good * by);
        if admits(&best) {
            found.push(best);
        }
    }
    found
}

/// Whether the minimum of every worker holds.
pub(super) fn admits(request: &Request) -> bool {
    Problem::new(request).is_ok_and(|problem| {
        let (minimum, _) = problem.amounts();
        let all: Vec<usize> = (0..problem.threads.len()).collect();
        assign::fits(&problem, &all, &minimum)
    })
}
