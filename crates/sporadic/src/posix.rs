//! The sporadic server of POSIX (XSH 2.8.4, `SCHED_SPORADIC`), rule by rule, defects included.
//!
//! ```text
//!            blocked ──────────────── activate ───────────────┐
//!               ▲                  (at P: R2)                 ▼
//!               │ block: R4, R6                            runnable
//!               └──────────────────────────────────────────┘  │
//!                                                             │ level: P iff avail > 0
//!      ┌──── charge: avail → 0: R5, R6 (or N pending: R4) ─┐  │        and #pending < N
//!      │                                                   ▼  │
//!     HIGH (P)                                           LOW (L)
//!      ▲                                                   │
//!      └───────── update: replenishment due: R7, R2 ───────┘
//! ```
//!
//! - **R1** At P, execution is limited to `avail`.
//! - **R2** Put at the tail of P's list (activated at P, or raised by a replenishment):
//!   `activation_time = now`.
//! - **R3** Preempted at P: `avail -= consumed`, not below 0. A charge, and no more.
//! - **R4** Blocks at P: R3, and a replenishment is scheduled.
//! - **R5** Reaches the limit: `avail = 0`, level Low, and a replenishment is scheduled.
//! - **R6** A replenishment gives back what was executed since `activation_time`, at
//!   `activation_time + T`, or at once if that is past.
//! - **R7** A replenishment adds its amount to `avail`, not above B; may raise the thread (R2).
//!
//! Two known defects follow from them (Stanovich et al., RTAS 2010): R3 forgets an overrun while
//! R6 gives it back (*budget amplification*), and one `activation_time` stands for budget that
//! arrived at different times (*premature replenishment*). `tests/it/defects.rs` shows both.

use crate::ring::Ring;
use crate::{BudgetServer, Chunk, Level, Nanos, ParamError, Params};

/// The sporadic server of POSIX, with room for `N` pending replenishments.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Posix<const N: usize> {
    params: Params,
    /// The latest time seen.
    clock: Nanos,
    runnable: bool,
    avail: Nanos,
    activation_time: Nanos,
    /// Executed since `activation_time` and not scheduled to come back yet.
    consumed: Nanos,
    replenishments: Ring<N>,
}

impl<const N: usize> Posix<N> {
    /// A server with its full budget at `now`, for a thread that is waiting.
    ///
    /// # Errors
    /// [`ParamError::MaxRepl`] if `max_repl` is above the capacity `N`.
    pub const fn new(params: Params, now: Nanos) -> Result<Self, ParamError> {
        if let Err(error) = params.check_capacity(N) {
            return Err(error);
        }
        Ok(Self::clamped(params, now))
    }

    /// As [`new`](Self::new), but a `max_repl` above the capacity counts as the capacity. For
    /// parameters that are checked already ([`Params::check_capacity`]): a server without a
    /// `Result` around it is made where it is to stay.
    #[must_use]
    pub const fn clamped(params: Params, now: Nanos) -> Self {
        Self {
            params,
            clock: now,
            runnable: false,
            avail: params.budget(),
            activation_time: now,
            consumed: 0,
            replenishments: Ring::new(),
        }
    }

    /// The pending replenishments in order of time.
    pub fn replenishments(&self) -> impl Iterator<Item = Chunk> + '_ {
        self.replenishments.iter()
    }

    /// `activation_time` of the rules.
    pub const fn activation_time(&self) -> Nanos {
        self.activation_time
    }

    /// Advances the clock, never back, and returns it.
    fn see(&mut self, now: Nanos) -> Nanos {
        self.clock = self.clock.max(now);
        self.clock
    }

    /// P iff avail > 0 and #pending < N.
    fn level(&self) -> Level {
        level(self.params.limit(N), self.avail, self.replenishments.len())
    }

    /// R7 for the replenishments that satisfy `due`.
    fn replenish(&mut self, now: Nanos, due: impl Fn(Nanos) -> bool) {
        while let Some(front) = self.replenishments.front()
            && due(front.time)
        {
            let before = self.level();
            self.replenishments.pop_front();
            self.give(front.amount, before, now);
        }
    }

    /// The effect of one replenishment: R7, and R2 if it raises a runnable thread.
    fn give(&mut self, amount: Nanos, before: Level, now: Nanos) {
        self.avail = self.avail.saturating_add(amount).min(self.params.budget());
        if self.runnable && before == Level::Low && self.level() == Level::High {
            self.activation_time = now;
        }
    }

    /// R6. Nothing executed, nothing scheduled.
    fn schedule(&mut self, now: Nanos) {
        let amount = core::mem::take(&mut self.consumed);
        if amount == 0 {
            return;
        }
        let time = self.activation_time.saturating_add(self.params.period());
        if time < now {
            let before = self.level();
            self.give(amount, before, now);
            return;
        }
        if let Some(last) = self.replenishments.back_mut()
            && last.time == time
        {
            // Charged after the limit was noticed (the thread was lowered late): the same
            // activation, so the same replenishment.
            last.amount = last.amount.saturating_add(amount);
            return;
        }
        // There is room: with N pending the level is Low and the activation stays as it is.
        let limit = self.params.limit(N);
        self.replenishments.push_back(Chunk { time, amount }, limit);
    }
}

fn level(limit: usize, avail: Nanos, pending: usize) -> Level {
    if avail > 0 && pending < limit {
        Level::High
    } else {
        Level::Low
    }
}

impl<const N: usize> BudgetServer for Posix<N> {
    fn params(&self) -> &Params {
        &self.params
    }

    fn activate(&mut self, now: Nanos) {
        let now = self.see(now);
        if self.runnable {
            self.block(now);
        }
        self.replenish(now, |time| time <= now);
        self.runnable = true;
        if self.level() == Level::High {
            self.activation_time = now; // R2
        }
    }

    fn block(&mut self, now: Nanos) {
        let now = self.see(now);
        self.runnable = false;
        self.schedule(now); // R4
    }

    /// Replenishments due before `now` count as given before the consumption, those due at `now`
    /// or later as after it.
    fn charge(&mut self, used: Nanos, now: Nanos) {
        let now = self.see(now);
        self.replenish(now, |time| time < now);
        self.avail = self.avail.saturating_sub(used); // R3, with its clamp
        self.consumed = self.consumed.saturating_add(used);
        if self.avail == 0 {
            self.schedule(now); // R5
        }
    }

    fn update(&mut self, now: Nanos) -> Level {
        let now = self.see(now);
        self.replenish(now, |time| time <= now);
        self.level()
    }

    fn available(&self, now: Nanos) -> Nanos {
        let now = self.clock.max(now);
        let due = self
            .replenishments
            .iter()
            .take_while(|chunk| chunk.time <= now);
        let (count, sum) = due.fold((0, self.avail), |(count, sum), chunk| {
            (
                count + 1,
                sum.saturating_add(chunk.amount).min(self.params.budget()),
            )
        });
        match level(self.params.limit(N), sum, self.replenishments.len() - count) {
            Level::High => sum,
            Level::Low => 0,
        }
    }

    fn next_replenishment(&self) -> Option<Nanos> {
        match self.level() {
            Level::High => None,
            Level::Low => self.replenishments.front().map(|chunk| chunk.time),
        }
    }

    fn pending(&self) -> usize {
        self.replenishments.len()
    }
}
