//! One supervised thread: a budget server plus what an enforcer must remember about the thread.
//!
//! The budget servers of this crate answer "which priority does the rule book give this thread
//! now?". Between that answer and a real thread lies bookkeeping that is the same on every
//! operating system: the thread's CPU clock is read now and then, what it consumed is charged to
//! the level at which it ran, the level is changed by somebody else and not at the very instant
//! of the decision, and a timer must be set so that the next decision is not late. A
//! [`Reservation`] is that bookkeeping, as a state machine over clock readings. It calls no
//! operating system; its owner feeds it readings and obeys [`Verdict`]s.
//!
//! Only [`judge`](Reservation::judge) gives verdicts, and the thread itself never calls it: a
//! thread that lowered itself could be preempted for good before it has set the timer that raises
//! it again. The calls of the thread ([`activate`](Reservation::activate),
//! [`block`](Reservation::block)) at most ask for a check at once.
//!
//! ```text
//!                      activate ──────────────► Runnable ─┐ judge: still funded
//!            Waiting ◄────────────── block ────    │  ▲ ◄─┘   (check again later)
//!   (judge lowers a thread that waits              │  │
//!    without budget, and raises it at              │  │
//!    its next replenishment)                       │  │
//!                            judge: exhausted      ▼  │  judge: replenished
//!                            verdict Low        at low priority, CPU time is free, but for
//!                                               what is owed (owe)
//! ```
//!
//! # The lazy timer
//! While a thread is funded, `now + available` can only grow until the next replenishment, since a
//! thread consumes at most as fast as time passes. One check time may therefore be early, never
//! late: it is neither cancelled nor moved when the thread waits. A check that comes early reads
//! the CPU clock and sets the next one.
//!
//! # No storms
//! The next check is never nearer than [`Tuning::min_rearm`]. A thread that makes no progress
//! because it is preempted (or blocks where we cannot see it) is checked at doubling distances
//! up to [`Tuning::backoff`]; [`Reservation::pull_in`] undoes that once the CPU is free.
//!
//! # Remnants
//! A funded thread with [`Tuning::slack`] or less left counts as exhausted. The remnant is charged
//! at once, in advance, and the thread may consume it at the beginning of its next round without
//! another charge. So no budget is lost from round to round, and a round is longer than the
//! budget by the slack at most.
//!
//! # Blocking that nobody records
//! A thread that blocks starts a new activation when it wakes, so its budget comes back later. A
//! reading that does not know ([`Readings::Unknown`]) counts as if the thread had blocked first
//! and then consumed everything in one piece, up to now. Every unit of budget comes back a
//! period after the latest moment at which it can have been consumed, or later. A thread that was
//! preempted loses as much of its period as it was kept off the CPU.

use crate::units::{earliest, later, latest, since};
use crate::{BudgetServer, Level, Nanos};

/// The end of time, in the place of no time at all.
const NEVER: Nanos = Nanos::MAX;

/// From a refused raise to the next attempt, at most.
const LONGEST_REFUSAL: Nanos = 100_000_000;

/// The enforcer's constants, all in nanoseconds. They depend on the machine, not on the load.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tuning {
    /// A funded thread with less than this left counts as exhausted: a check for a shorter time
    /// would cost more than it decides.
    pub slack: Nanos,
    /// No check is set nearer than this: the guard against a timer that is always already past.
    pub min_rearm: Nanos,
    /// The longest distance between two checks of a thread that makes no progress. It bounds the
    /// overrun of a thread that resumes unseen; see [`backoff`](Self::backoff).
    pub max_backoff: Nanos,
}

impl Tuning {
    /// For Linux, from measurements (`docs/enforcement.md`).
    pub const LINUX: Self = Self {
        slack: 10_000,
        min_rearm: 10_000,
        max_backoff: 1_000_000,
    };

    /// The constants for a budget: up to a 200th of it, but no more than 2.5 times
    /// [`slack`](Self::slack), counts as slack. A check that finds a little more than the slack
    /// costs two more switches to the enforcer; a small budget would pay with its precision.
    #[must_use]
    pub fn for_budget(self, budget: Nanos) -> Self {
        let most = self.slack.saturating_mul(5) / 2;
        Self {
            slack: self.slack.max(most.min(budget / 200)),
            ..self
        }
    }

    /// The longest distance between two checks of a thread with this budget that makes no progress:
    /// a quarter of the budget, but at least five times `min_rearm` and at most `max_backoff`. A
    /// thread that blocks inside a callback and resumes unseen overruns its budget by this much.
    #[must_use]
    pub fn backoff(&self, budget: Nanos) -> Nanos {
        (budget / 4)
            .max(self.min_rearm.saturating_mul(5))
            .min(self.max_backoff)
    }
}

/// A stretch inside a callback in which the thread was blocked, as context-switch records show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockedInterval {
    /// CPU time consumed between the previous reading (or the previous interval) and `out_at`.
    pub ran: Nanos,
    /// When the thread blocked.
    pub out_at: Nanos,
    /// When it ran again. An upper bound is safe: it delays a replenishment, never advances one.
    pub in_at: Nanos,
}

/// The owner's knowledge about blocking since the previous reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Readings<'a> {
    /// The thread blocked in these stretches, the earliest first, and in no others. Without any, it
    /// was running or preempted all the time. A counter of voluntary switches that has not moved
    /// proves that, unless the thread was already blocked at the previous reading.
    Exact(&'a [BlockedInterval]),
    /// The thread may have blocked at any time: nobody records it, or records were lost.
    Unknown,
}

/// The thread did not block.
const NOT_BLOCKED: Readings<'static> = Readings::Exact(&[]);

/// The change that the owner of a reservation must make after a call.
#[must_use]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// The level to give the thread now; `None`: leave it. Confirm with [`Reservation::applied`],
    /// or with [`Reservation::refused`] where the system did not obey.
    pub change: Option<Level>,
}

/// Counters and sums of a reservation; CPU times in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// CPU time consumed at the high priority.
    pub cpu_high: Nanos,
    /// CPU time consumed at the low priority.
    pub cpu_low: Nanos,
    /// The part of it that was charged to the budget after all ([`Reservation::owe`]).
    pub owed: Nanos,
    /// Times that the budget ran out while the thread ran.
    pub exhaustions: u64,
    /// Times that a replenishment raised the thread.
    pub replenishments: u64,
    /// Stretches of blocking inside callbacks that were seen and accounted.
    pub blocked_inside: u64,
    /// Checks that found the thread funded and set a later one.
    pub early_checks: u64,
    /// Checks that found no progress at all.
    pub idle_checks: u64,
}

/// A budget server and the bookkeeping of the thread it supervises.
#[derive(Clone, Debug)]
pub struct Reservation<S> {
    server: S,
    tuning: Tuning,
    runnable: bool,
    level: Level,
    cpu_mark: Nanos,
    read_at: Nanos,
    /// [`NEVER`]: not before another event.
    check_at: Nanos,
    /// The last change was refused: `check_at` is the next attempt.
    refused: bool,
    backoff: Nanos,
    /// Charged, but not consumed yet; at most the slack.
    advance: Nanos,
    margin: i64,
    counters: Counters,
}

impl<S: BudgetServer> Reservation<S> {
    /// Supervises a thread that waits, is at the high level and whose CPU clock shows `cpu`.
    pub fn new(server: S, tuning: Tuning, now: Nanos, cpu: Nanos) -> Self {
        Self {
            server,
            tuning,
            runnable: false,
            level: Level::High,
            cpu_mark: cpu,
            read_at: now,
            check_at: NEVER,
            refused: false,
            backoff: 0,
            advance: 0,
            margin: 0,
            counters: Counters::default(),
        }
    }

    /// The server inside.
    pub fn server(&self) -> &S {
        &self.server
    }

    /// The level that was last confirmed by [`applied`](Self::applied).
    pub fn level(&self) -> Level {
        self.level
    }

    /// Whether the thread is between [`activate`](Self::activate) and [`block`](Self::block).
    pub fn is_runnable(&self) -> bool {
        self.runnable
    }

    /// When [`judge`](Self::judge) must be called next; `None`: not before another event.
    pub fn check_at(&self) -> Option<Nanos> {
        (self.check_at != NEVER).then_some(self.check_at)
    }

    /// The reading of the thread's CPU clock to wait for instead of [`check_at`](Self::check_at),
    /// where the system has a timer on that clock. `None` while CPU time alone decides nothing.
    pub fn limit(&self) -> Option<Nanos> {
        if !self.runnable || self.level == Level::Low {
            return None;
        }
        let left = self.left(self.read_at);
        Some(later(self.cpu_mark, latest(left, self.tuning.min_rearm)))
    }

    /// Counters up to the last reading.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// CPU time at the last reading and when that reading was taken.
    pub fn last_reading(&self) -> (Nanos, Nanos) {
        (self.cpu_mark, self.read_at)
    }

    /// The thread leaves its wait. `woken` is when it became runnable, which can be long before
    /// `now`, when it first ran, if it had to wait for the CPU: budget comes back a period after
    /// `woken` (POSIX rule R2), so a thread that is kept waiting is not also replenished late.
    /// Times before the last wait began count as its beginning, times after `now` as `now`.
    ///
    /// Consumption on the way into and out of the wait since the last reading belongs to the
    /// new activation, so that no CPU time escapes the account.
    pub fn activate(&mut self, woken: Nanos, now: Nanos, cpu: Nanos) {
        self.runnable = true;
        self.server
            .activate(earliest(latest(woken, self.read_at), now));
        self.backoff = 0;
        self.account(now, cpu, NOT_BLOCKED);
        self.replan(now);
    }

    /// The thread is about to wait. If its budget is used up just now, a check is due at once: a
    /// thread that waited at its high level would have it after the next wake-up, too, until
    /// somebody has looked. After a refused change it keeps its level while it waits, where it does
    /// no harm.
    pub fn block(&mut self, now: Nanos, cpu: Nanos, readings: Readings<'_>) {
        self.account(now, cpu, readings);
        self.server.block(now);
        self.runnable = false;
        self.replan(now);
    }

    /// Decides by a fresh reading of the CPU clock; due at [`check_at`](Self::check_at), allowed at
    /// any time.
    pub fn judge(&mut self, now: Nanos, cpu: Nanos, readings: Readings<'_>) -> Verdict {
        let was_refused = core::mem::take(&mut self.refused);
        if self.sleeps_funded() || was_refused && self.sleeps_high() {
            self.check_at = NEVER;
            return Verdict { change: None };
        }
        let elapsed = since(now, self.read_at);
        let used = since(cpu, self.cpu_mark);
        self.check_at = NEVER;
        let funded_before = self.level == Level::High;
        self.account(now, cpu, readings);
        if funded_before && self.runnable && used < elapsed / 8 {
            self.counters.idle_checks += 1;
            let doubled = (self.backoff * 2).max(self.tuning.min_rearm * 2);
            let longest = self.tuning.backoff(self.server.params().budget());
            self.backoff = earliest(doubled, longest);
        } else {
            self.backoff = 0;
        }
        let verdict = self.decide(now);
        if verdict.change.is_none() && self.runnable && self.level == Level::High {
            self.counters.early_checks += 1;
        }
        verdict
    }

    /// Reads without deciding: brings the counters up to date. The next check can come nearer.
    pub fn observe(&mut self, now: Nanos, cpu: Nanos, readings: Readings<'_>) {
        if !self.sleeps_funded() {
            self.account(now, cpu, readings);
            self.replan(now);
        }
    }

    /// Charges `amount` of CPU time at the low level to the budget after all: time that the thread
    /// had although it was to be stopped, or at a priority that it had inherited. It is a debt: the
    /// next replenishment comes later by what it takes to pay it. To be called before the reading
    /// that accounts the same time, so that no verdict comes before the debt.
    pub fn owe(&mut self, amount: Nanos, now: Nanos) {
        self.server.charge(amount, now);
        self.counters.owed += amount;
    }

    /// The verdict was carried out: the thread has had the level since `now`, when its CPU clock
    /// showed `cpu`. Returns the overrun of the budget in nanoseconds (negative: stopped early by
    /// less than the slack) if this ended a funded stretch.
    pub fn applied(&mut self, level: Level, now: Nanos, cpu: Nanos) -> Option<i64> {
        let late = since(cpu, self.cpu_mark);
        let overrun = self.margin.saturating_add_unsigned(late);
        self.account(now, cpu, NOT_BLOCKED);
        let before = core::mem::replace(&mut self.level, level);
        if before == level {
            return None;
        }
        self.check_at = NEVER;
        self.refused = false;
        self.backoff = 0;
        self.replan(now);
        match level {
            Level::High => {
                self.counters.replenishments += 1;
                None
            }
            // It waited with the last of its budget: nothing was cut short.
            Level::Low if !self.runnable => None,
            Level::Low => {
                self.counters.exhaustions += 1;
                Some(overrun)
            }
        }
    }

    /// The verdict could not be carried out, for instance because a privilege is gone. The thread
    /// keeps its level: what it consumes at the high one beyond its budget is a debt. The next
    /// check, which gives the same verdict again, is due as soon as a check may be put off
    /// ([`Tuning::backoff`]) where the thread could not be lowered. A raise waits for half a
    /// period, but for 100 ms at most, and not less than [`Tuning::max_backoff`]. An activation or
    /// a reading in between does not bring the attempt forward.
    pub fn refused(&mut self, now: Nanos) {
        let params = self.server.params();
        let pause = match self.level {
            Level::High => self.tuning.backoff(params.budget()),
            Level::Low => LONGEST_REFUSAL
                .min(params.period() / 2)
                .max(self.tuning.max_backoff),
        };
        self.check_at = later(now, pause);
        self.refused = true;
    }

    /// The CPU became free: a check that was put off for want of progress is due again when the
    /// budget can end if the thread has consumed nothing since the last reading. Returns whether
    /// [`check_at`](Self::check_at) moved; it never moves away, since the thread may have consumed
    /// something.
    pub fn pull_in(&mut self, now: Nanos) -> bool {
        if self.backoff == 0 || !self.runnable || self.level == Level::Low {
            return false;
        }
        self.backoff = 0;
        let before = self.check_at;
        self.plan(now);
        self.check_at != before
    }

    /// The thread could not run for another `by` nanoseconds, since somebody it cannot preempt had
    /// its CPU: a check for the end of its budget moves by as much.
    pub fn postpone(&mut self, by: Nanos) {
        if self.runnable && self.level == Level::High {
            self.check_at = later(self.check_at, by);
        }
    }

    /// Whether the next check was put off for want of progress.
    pub fn is_backed_off(&self) -> bool {
        self.backoff > 0
    }

    /// Nothing can happen to a thread that waits at the high level with budget, and the server must
    /// not see time pass, or a wake-up before now could no longer be told it.
    fn sleeps_funded(&self) -> bool {
        self.sleeps_high() && self.server.available(self.read_at) > 0
    }

    fn sleeps_high(&self) -> bool {
        !self.runnable && self.level == Level::High
    }

    /// Charges what the CPU clock shows since the last reading to the level in force.
    fn account(&mut self, now: Nanos, cpu: Nanos, readings: Readings<'_>) {
        let used = since(cpu, self.cpu_mark);
        self.cpu_mark = latest(self.cpu_mark, cpu);
        self.read_at = latest(self.read_at, now);
        let mut rest = match self.level {
            Level::High => used,
            Level::Low => 0,
        };
        self.counters.cpu_high += rest;
        self.counters.cpu_low += used - rest;
        if self.runnable {
            match readings {
                Readings::Exact(intervals) => {
                    for interval in intervals {
                        let ran = earliest(interval.ran, rest);
                        rest -= ran;
                        let due = self.unpaid(ran);
                        self.server.charge(due, interval.out_at);
                        self.server.block(interval.out_at);
                        self.server.activate(interval.in_at);
                        self.counters.blocked_inside += 1;
                    }
                }
                // It may have blocked up to the moment from which it has run without a pause.
                Readings::Unknown => self.server.activate(since(now, used)),
            }
        }
        if self.level == Level::Low {
            return;
        }
        let due = self.unpaid(rest);
        let funded = self.server.available(now);
        self.margin = signed(due) - signed(funded);
        let left = since(funded, due);
        if due > 0 && left <= self.tuning.slack && self.runnable {
            self.advance = left;
            self.server.charge(due + left, now);
        } else {
            self.server.charge(due, now);
        }
    }

    /// The part of this consumption that is still to be charged.
    #[cfg_attr(target_os = "none", inline(never))]
    fn unpaid(&mut self, used: Nanos) -> Nanos {
        let paid = earliest(self.advance, used);
        self.advance -= paid;
        used - paid
    }

    /// CPU time that a funded thread may consume from `now` on.
    fn left(&self, now: Nanos) -> Nanos {
        later(self.server.available(now), self.advance)
    }

    fn decide(&mut self, now: Nanos) -> Verdict {
        let want = self.server.update(now);
        if want != self.level {
            return Verdict { change: Some(want) };
        }
        self.plan(now);
        Verdict { change: None }
    }

    /// Sets the next check: at once if the level in force is not, or no longer, the right one.
    /// After a refusal the next attempt stands: a thread that wakes often must not ask each time.
    fn replan(&mut self, now: Nanos) {
        if self.server.update(now) == self.level {
            self.refused = false;
            self.plan(now);
        } else if !self.refused {
            self.check_at = now;
        }
    }

    /// Sets the next check; an earlier one that is already set stays (the lazy timer).
    fn plan(&mut self, now: Nanos) {
        let wanted = match self.level {
            Level::Low => self.server.next_replenishment().unwrap_or(NEVER),
            Level::High if self.runnable => {
                let left = self.left(now);
                later(
                    now,
                    latest(latest(left, self.tuning.min_rearm), self.backoff),
                )
            }
            Level::High => return, // waiting and funded: an old check may stay, it does no harm
        };
        self.check_at = earliest(self.check_at, wanted);
    }
}

fn signed(v: Nanos) -> i64 {
    i64::try_from(v).unwrap_or(i64::MAX)
}
