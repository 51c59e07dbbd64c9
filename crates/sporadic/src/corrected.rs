//! The corrected sporadic server: a queue of chunks whose amounts always sum to B.
//!
//! ```text
//!                 head                 further chunks, at most max_repl, by time
//!            (time, amount)  ──►  (time, amount)  (time, amount)  …        Σ amount = B
//!                 │                                       ▲                times ≤ head.time + T
//!                 │ consumed with e = head.time           │
//!                 └───────────── comes back at e + T ─────┘
//!
//!                       head.time ≤ now                head.time ≤ now
//!                  ┌──────────────────────┐        ┌────────────────────┐
//!                  │   time passes        ▼        ▼  activate: all due │
//!   level:        LOW                    HIGH ─────────  chunks → now ──┘
//!                  ▲                      │
//!                  └──────────────────────┘
//!               charge: the due chunks are spent, the new head is in the future
//!               (an overrun has taken part of it already: debt)
//! ```
//!
//! The time of a chunk is the *effective activation* e of what is consumed from it:
//! - the activation of the thread, if the chunk was due by then;
//! - its own replenishment time, if it became due while the thread was runnable (also if the
//!   thread was raised later than that: no drift);
//! - its own replenishment time, still in the future, if it was consumed early by an overrun;
//! - a period before it was consumed, if it was due for longer than that: budget that could not be
//!   had within its period comes back later by as much as it was late.
//!
//! Each unit of budget comes back T after its e, or later (merging keeps the later time), so two
//! uses of one unit have activations at least T apart. Hence for every window [t, t+T) the units
//! with e in the window sum to at most B: the interference of a periodic task (B, T). Since no unit
//! is consumed more than T after its e, a thread that was kept waiting executes two budgets
//! back to back at most, however long it waited.
//!
//! Source: the rules in Stanovich, Baker, Wang, González Harbour: "Defects of the POSIX Sporadic
//! Server and How to Correct Them", RTAS 2010, DOI 10.1109/RTAS.2010.34. Unlike there, a chunk
//! that becomes due while the head before it runs is not merged into that head (which would give
//! it an earlier activation), and a remnant that is too small goes to the next chunk only.

use crate::ring::Ring;
use crate::units::{earliest, later, latest, since};
use crate::{BudgetServer, Chunk, Level, Nanos, ParamError, Params};

/// The corrected sporadic server, with room for `N` pending replenishments.
///
/// `max_repl` counts the chunks behind the head. If one more is needed, the two youngest become
/// one at the later time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Corrected<const N: usize> {
    params: Params,
    min_chunk: Nanos,
    /// The latest time seen.
    clock: Nanos,
    /// The chunk that is consumed next. Its amount is never 0.
    head: Chunk,
    queue: Ring<N>,
}

/// A piece of consumption, as [`Corrected::charge_with`] reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Consumed {
    /// The effective activation e of the piece.
    pub activation: Nanos,
    /// CPU time that was consumed, in ns.
    pub amount: Nanos,
    /// Number of times: at e, e + T, e + 2T, ... More than 1 only if a charge exceeds the budget.
    pub rounds: Nanos,
}

impl<const N: usize> Corrected<N> {
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
        let head = Chunk {
            time: now,
            amount: params.budget(),
        };
        Self {
            params,
            min_chunk: 0,
            clock: now,
            head,
            queue: Ring::new(),
        }
    }

    /// Sets the smallest amount worth raising the thread for, in ns (0 at first). A smaller head is
    /// merged into the next chunk, at that chunk's later time, so that the thread stays Low rather
    /// than run for a sliver. Without a next chunk the head is kept as it is.
    #[must_use]
    pub const fn with_min_chunk(mut self, min_chunk: Nanos) -> Self {
        self.min_chunk = min_chunk;
        self
    }

    /// See [`with_min_chunk`](Self::with_min_chunk).
    pub const fn min_chunk(&self) -> Nanos {
        self.min_chunk
    }

    /// All chunks in order of time, the head first. Their amounts sum to B.
    pub fn chunks(&self) -> impl Iterator<Item = Chunk> + '_ {
        core::iter::once(self.head).chain(self.queue.iter())
    }

    /// [`charge`](BudgetServer::charge) that reports each piece consumed and its effective
    /// activation, in order of time within a round.
    pub fn charge_with(&mut self, used: Nanos, now: Nanos, observe: &mut impl FnMut(Consumed)) {
        let now = self.see(now);
        let (budget, period) = (self.params.budget(), self.params.period());
        self.count_from(since(since(now, used), period));
        // Consuming exactly B takes every chunk once, so all come back T later.
        // This is rare, and division is slow on small processors.
        let (rounds, mut rest) = if used < budget {
            (0, used)
        } else {
            (used / budget, used - used / budget * budget)
        };
        if rounds > 0 {
            let delay = rounds.saturating_mul(period);
            let mut take = |chunk: &mut Chunk| {
                observe(Consumed {
                    activation: chunk.time,
                    amount: chunk.amount,
                    rounds,
                });
                chunk.time = later(chunk.time, delay);
            };
            take(&mut self.head);
            self.queue.each(take);
        }
        while rest > 0 {
            let Chunk { time, amount } = self.head;
            let taken = earliest(rest, amount);
            rest -= taken;
            observe(Consumed {
                activation: time,
                amount: taken,
                rounds: 1,
            });
            let back = Chunk {
                time: later(time, period),
                amount: taken,
            };
            if taken < amount {
                self.head.amount -= taken;
            } else if let Some(next) = self.queue.pop_front() {
                self.head = next;
            } else {
                self.head = back;
                continue;
            }
            self.push(back);
        }
        while self.head.amount < self.min_chunk
            && let Some(next) = self.queue.pop_front()
        {
            self.head = Chunk {
                time: next.time,
                amount: self.head.amount + next.amount,
            };
        }
    }

    /// Advances the clock, never back, and returns it.
    #[cfg_attr(target_os = "none", inline(never))]
    fn see(&mut self, now: Nanos) -> Nanos {
        self.clock = latest(self.clock, now);
        self.clock
    }

    /// Budget that is due at `time` has its activation there, not before.
    fn count_from(&mut self, time: Nanos) {
        if self.head.time > time {
            return;
        }
        self.head.time = time;
        while let Some(next) = self.queue.front()
            && next.time <= time
        {
            self.queue.pop_front();
            self.head.amount += next.amount;
        }
    }

    /// Queues a chunk that is not before any other. Merged with the youngest, at the later time, if
    /// their times are equal or the queue is full.
    fn push(&mut self, chunk: Chunk) {
        let limit = self.params.limit(N);
        let full = self.queue.len() >= limit;
        let youngest = self.queue.back_mut().unwrap_or(&mut self.head);
        if full || youngest.time == chunk.time {
            youngest.time = chunk.time;
            youngest.amount += chunk.amount;
        } else {
            self.queue.push_back(chunk, limit);
        }
    }
}

impl<const N: usize> BudgetServer for Corrected<N> {
    fn params(&self) -> &Params {
        &self.params
    }

    fn activate(&mut self, now: Nanos) {
        let now = self.see(now);
        self.count_from(now);
    }

    /// Notes only the time: consumed budget is queued already, and the rest gets its activation
    /// from the next [`activate`](Self::activate).
    fn block(&mut self, now: Nanos) {
        self.see(now);
    }

    fn charge(&mut self, used: Nanos, now: Nanos) {
        self.charge_with(used, now, &mut |_| ());
    }

    #[cfg_attr(target_os = "none", inline(never))]
    fn update(&mut self, now: Nanos) -> Level {
        if self.head.time <= self.see(now) {
            Level::High
        } else {
            Level::Low
        }
    }

    fn available(&self, now: Nanos) -> Nanos {
        let now = latest(self.clock, now);
        if self.head.time > now {
            return 0;
        }
        let due = self.queue.iter().take_while(|chunk| chunk.time <= now);
        due.fold(self.head.amount, |sum, chunk| sum + chunk.amount)
    }

    fn next_replenishment(&self) -> Option<Nanos> {
        (self.head.time > self.clock).then_some(self.head.time)
    }

    /// Chunks in the future, at most `max_repl + 1`: the head too, while Low.
    fn pending(&self) -> usize {
        self.chunks()
            .filter(|chunk| chunk.time > self.clock)
            .count()
    }
}
