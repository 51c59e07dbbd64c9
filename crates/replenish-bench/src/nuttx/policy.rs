//! The policy that NuttX calls `SCHED_SPORADIC`: a free-running generator of time slots.
//!
//! It is emulated tick by tick, to explain measurements. **Not a budget server**; never schedule
//! anything with it.
//!
//! ```text
//!                  start
//!                    │
//!                    ▼    budget timer (B ticks of wall time)
//!             ┌─► HIGH ──────────────────────────────────────► LOW ─┐
//!             │     suspended meanwhile? then a credit            │
//!             └────────────────────────────────────────────────────┘
//!                          interval timer (T - B ticks)
//!
//!   credit, beside the cycle:   DELAY (T/2 - u ticks) ──► HIGH for u ticks ──► LOW, timer freed
//!   u: how long the thread did not have the CPU; given again when it resumes with budget left
//! ```
//!
//! It is no [`BudgetServer`](sporadic::BudgetServer), because it is driven by other events: timer
//! ticks of the running thread and context switches in, out and by preemption, where a budget
//! server knows activations, consumption and waits. It does not know how much budget is left, so
//! it cannot be asked for that. So it has an interface of its own, in ticks: each event returns
//! [`Effects`], the timers to start and the level to set, in that order. Timers, ready list and
//! context switches belong to the kernel around it ([`Kernel`](super::Kernel)).
//!
//! Written from a description of the state machine of `sched/sched/sched_sporadic.c`; the parts
//! for a locked scheduler are left out. How it deviates from a sporadic server: budget is wall
//! time, it is credited for what was *not* executed, half a period later, and being preempted
//! counts as waiting. `docs/nuttx-history.md` tells the consequences.

use sporadic::Level;

/// The states of a timer of the pool.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Free,
    /// The main timer, high: the budget runs.
    Budget,
    /// The main timer, low: the rest of the period.
    Interval,
    /// A credit that is not yet given.
    Delay,
    /// A credit that is being given.
    Replenish,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Slot {
    phase: Phase,
    /// Ticks that the slot gives; 32 bits as in C, also for numbers that are negative there.
    budget: u32,
}

/// A watchdog timer to start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arm {
    /// The index of the timer. One that runs is started afresh.
    pub slot: usize,
    /// The delay in ticks as handed to `wd_start`, which refuses a negative one (the timer then
    /// never expires) and counts one tick more than asked.
    pub delay: i32,
}

/// Changes that the kernel must make after an event: first start the timers, then set the level.
#[must_use]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Effects {
    /// Timers to start, in order.
    pub arm: [Option<Arm>; 2],
    /// The level to set. Setting the level in force is not without effect: it moves the thread
    /// behind its equals.
    pub level: Option<Level>,
}

/// The emulation of one thread's policy, with a pool of `N` timers. Times are in ticks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Nuttx<const N: usize> {
    budget: u32,
    period: u32,
    max_repl: usize,
    reversed: bool,
    timeslice: i32,
    suspended: bool,
    event_time: u32,
    active: usize,
    slots: [Slot; N],
}

impl<const N: usize> Nuttx<N> {
    /// A thread with `budget` ticks of each `period`, using up to `max_repl` of the `N` timers
    /// (at least 1: the main timer is one of them; more than `N` counts as `N`). As in
    /// `pthread_create` nothing else is checked; a budget above the period counts as the period.
    pub const fn new(budget: u32, period: u32, max_repl: usize) -> Self {
        const { assert!(N > 0, "the main timer needs a slot") };
        let free = Slot {
            phase: Phase::Free,
            budget: 0,
        };
        Self {
            budget: if budget < period { budget } else { period },
            period,
            max_repl: if max_repl < 1 {
                1
            } else if max_repl > N {
                N
            } else {
                max_repl
            },
            reversed: false,
            timeslice: 0,
            suspended: true,
            event_time: 0,
            active: 0,
            slots: [free; N],
        }
    }

    /// Reverses the subtraction when the budget expires, as NuttX did before 10.1 (fixed by
    /// 2208aabbc6e): a credit becomes an unbounded grant and its timer is lost.
    #[must_use]
    pub const fn with_reversed_subtraction(mut self, reversed: bool) -> Self {
        self.reversed = reversed;
        self
    }

    /// The thread is created (it does not run yet).
    pub fn start(&mut self, now: u32) -> Effects {
        self.suspended = true;
        self.event_time = now;
        self.begin_budget(now)
    }

    /// The thread gets the CPU. Only ever starts a timer.
    pub fn resume(&mut self, now: u32) -> Effects {
        if !self.suspended {
            return Effects::default();
        }
        self.suspended = false;
        if self.timeslice > 0 {
            let unrealized = now.wrapping_sub(self.event_time);
            if unrealized > 0 {
                if unrealized >= self.timeslice.cast_unsigned() {
                    return Effects::default(); // lost; the event time stays what it was
                }
                self.timeslice -= unrealized.cast_signed();
                let last = self.slots[self.active].budget;
                if self.timeslice.cast_unsigned() < last
                    && let Some(arm) = self.credit(unrealized)
                {
                    return Effects {
                        arm: [Some(arm), None],
                        level: None,
                    };
                }
            }
        }
        self.event_time = now;
        Effects::default()
    }

    /// The thread loses the CPU, for whatever reason.
    pub fn suspend(&mut self, now: u32) {
        if !self.suspended {
            self.suspended = true;
            self.event_time = now;
        }
    }

    /// A tick finds the thread running. The timers, not this, end the budget.
    pub fn tick(&mut self) {
        // Compared without sign, as in C: what is negative counts on downwards.
        if self.timeslice.cast_unsigned() > 1 {
            self.timeslice = self.timeslice.wrapping_sub(1);
        } else if self.timeslice == 1 && self.budget >= self.period {
            self.timeslice = self.budget.cast_signed();
        }
    }

    /// A timer has expired.
    pub fn expire(&mut self, slot: usize, now: u32) -> Effects {
        match self.slots.get(slot).map(|s| s.phase) {
            Some(Phase::Budget) => self.end_budget(now),
            Some(Phase::Interval) => self.begin_budget(now),
            Some(Phase::Delay) => self.begin_credit(slot),
            Some(Phase::Replenish) => {
                self.timeslice = 0;
                self.slots[slot].phase = Phase::Free;
                Effects {
                    arm: [None; 2],
                    level: Some(Level::Low),
                }
            }
            Some(Phase::Free) | None => Effects::default(),
        }
    }

    /// Timers of the pool that are taken, the main one included.
    pub fn taken(&self) -> usize {
        self.slots.iter().filter(|s| s.phase != Phase::Free).count()
    }

    fn begin_budget(&mut self, now: u32) -> Effects {
        self.timeslice = self.budget.cast_signed();
        self.active = 0;
        self.slots[0] = Slot {
            phase: Phase::Budget,
            budget: self.budget,
        };
        self.event_time = now;
        Effects {
            arm: [Some(self.arm(0, self.budget)), None],
            level: Some(Level::High),
        }
    }

    fn end_budget(&mut self, now: u32) -> Effects {
        let mut first = None;
        if self.suspended {
            let unrealized = if self.reversed {
                self.event_time.wrapping_sub(now)
            } else {
                now.wrapping_sub(self.event_time)
            };
            if unrealized > 0 {
                first = self.credit(unrealized);
            }
        }
        self.timeslice = 0;
        self.active = 0;
        let rest = self.period - self.budget;
        let mut effects = if rest == 0 {
            self.begin_budget(now)
        } else {
            self.slots[0].phase = Phase::Interval;
            Effects {
                arm: [Some(self.arm(0, rest)), None],
                level: Some(Level::Low),
            }
        };
        if first.is_some() {
            effects.arm = [first, effects.arm[0]];
        }
        effects
    }

    fn begin_credit(&mut self, slot: usize) -> Effects {
        let amount = self.slots[slot].budget;
        self.timeslice = amount.cast_signed();
        self.active = slot;
        self.slots[slot].phase = Phase::Replenish;
        Effects {
            arm: [Some(self.arm(slot, amount)), None],
            level: Some(Level::High),
        }
    }

    /// Takes a timer for a credit; `None` if the pool is used up.
    fn credit(&mut self, unrealized: u32) -> Option<Arm> {
        let pool = &mut self.slots[..self.max_repl];
        let slot = pool.iter().position(|s| s.phase == Phase::Free)?;
        pool[slot] = Slot {
            phase: Phase::Delay,
            budget: unrealized,
        };
        Some(self.arm(slot, (self.period / 2).wrapping_sub(unrealized)))
    }

    const fn arm(&self, slot: usize, delay: u32) -> Arm {
        Arm {
            slot,
            delay: delay.cast_signed(),
        }
    }
}
