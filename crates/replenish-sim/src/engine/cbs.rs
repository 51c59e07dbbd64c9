//! `SCHED_DEADLINE`: a hard constant-bandwidth server per thread (Abeni, Buttazzo, RTSS 1998), with
//! the rules of Linux (`kernel/sched/deadline.c`, described in
//! `Documentation/scheduler/sched-deadline.rst`).
//!
//! - Wake-up: the current runtime and deadline go on if their quotient does not exceed
//!   runtime/deadline, else a new deadline and full runtime (with a constrained deadline the
//!   "revised" rule: the runtime shrinks to what the time left is worth).
//! - Runtime used up: throttled to the end of the period, then the deadline moves on by a period.

use super::phase::Rank;
use crate::Nanos;

#[derive(Debug, Clone)]
pub(super) struct Cbs {
    runtime: Nanos,
    relative: Nanos,
    period: Nanos,
    /// Runtime left, negative after an overrun.
    pub(super) left: i128,
    /// Absolute deadline; the server is fresh (first wake-up) while it is `None`.
    deadline: Option<Nanos>,
    pub(super) throttled: bool,
    pub(super) unthrottle_at: Option<Nanos>,
}

impl Cbs {
    pub(super) fn new(runtime: Nanos, relative: Nanos, period: Nanos) -> Self {
        Self {
            runtime,
            relative,
            period,
            left: 0,
            deadline: None,
            throttled: false,
            unthrottle_at: None,
        }
    }

    /// Above all FIFO priorities, earlier deadlines first; `None` while throttled.
    pub(super) fn rank(&self) -> Option<Rank> {
        if self.throttled {
            return None;
        }
        let deadline = self.deadline.unwrap_or(0);
        Some((Rank::MAX - deadline).max(Rank::from(u8::MAX) + 1))
    }

    pub(super) fn consume(&mut self, span: Nanos) {
        self.left -= i128::from(span);
    }

    /// Runtime left, at least 0.
    pub(super) fn runtime_left(&self) -> Nanos {
        Nanos::try_from(self.left.max(0)).unwrap_or(Nanos::MAX)
    }

    fn fresh(&mut self, now: Nanos) {
        self.deadline = Some(now.saturating_add(self.relative));
        self.left = i128::from(self.runtime);
    }

    pub(super) fn wake(&mut self, now: Nanos) {
        if self.throttled {
            return;
        }
        match self.deadline {
            None => self.fresh(now),
            Some(deadline) if deadline <= now => {
                let next_period = deadline - self.relative + self.period;
                if now < next_period {
                    self.throttled = true; // a constrained deadline has passed, its period not
                } else {
                    self.fresh(now);
                }
            }
            Some(deadline) => {
                let laxity = i128::from(deadline - now);
                let fair = laxity * i128::from(self.runtime) / i128::from(self.relative);
                let over =
                    self.left * i128::from(self.relative) > laxity * i128::from(self.runtime);
                if over && self.relative < self.period {
                    self.left = fair;
                } else if over {
                    self.fresh(now);
                }
            }
        }
    }

    /// Time at which a throttled server gets runtime again.
    pub(super) fn next_period(&self) -> Nanos {
        let deadline = self.deadline.unwrap_or(0);
        deadline
            .saturating_sub(self.relative)
            .saturating_add(self.period)
    }

    pub(super) fn replenish(&mut self, now: Nanos) {
        self.throttled = false;
        let mut deadline = self.deadline.unwrap_or(now);
        loop {
            self.left += i128::from(self.runtime);
            deadline = deadline.saturating_add(self.period);
            if self.left > 0 {
                break;
            }
        }
        self.left = self.left.min(i128::from(self.runtime));
        self.deadline = Some(deadline);
        if deadline <= now {
            self.fresh(now);
        }
    }
}
