//! Drives the budget servers of `sporadic`: their inputs, and the times at which they are asked.
//!
//! With [`Enforcement::Kernel`] the server knows a wake-up when it happens, and a running thread is
//! judged when what it may consume is used up (at the next tick, if there is one). With
//! [`Enforcement::Timer`] everything goes as in `replenish-os`: the worker itself reports its
//! wake-up when it first runs, and it is judged when the lazy timer says so, late.

use super::simulation::{Sim, Timer};
use super::state::Noted;
use crate::{End, Enforcement, Nanos, What};
use sporadic::{BudgetServer, Level, Readings, Verdict};

/// The simulation reports a block when it happens, as a wait of its own.
const NO_GAPS: Readings<'static> = Readings::Exact(&[]);

impl Sim<'_> {
    fn by_timer(&self) -> bool {
        matches!(self.system.platform.enforcement, Enforcement::Timer { .. })
    }

    /// The thread became runnable.
    pub(super) fn wake_budget(&mut self, id: usize) {
        if self.states[id].budget.is_none() {
            return;
        }
        if self.by_timer() {
            self.states[id].woken = Some(self.now);
        } else {
            self.activate_budget(id, self.now);
        }
    }

    /// Notes in its server that it woke at `woken`.
    pub(super) fn activate_budget(&mut self, id: usize, woken: Nanos) {
        let now = self.now;
        let state = &mut self.states[id];
        if let Some(budget) = &mut state.budget {
            budget.activate(woken, now, state.cpu_clock);
            self.consider(id);
        }
    }

    /// After the thread's own report: a kernel decides at once, an enforcer when its timer says so.
    fn consider(&mut self, id: usize) {
        let by_timer = self.by_timer();
        let now = self.now;
        let state = &mut self.states[id];
        if let Some(budget) = &mut state.budget
            && !by_timer
        {
            let verdict = budget.judge(now, state.cpu_clock, NO_GAPS);
            self.obey(id, verdict);
        }
        self.set_check(id);
    }

    /// The thread blocks inside a job.
    pub(super) fn block_budget(&mut self, id: usize) {
        if self.system.platform.blocking_seen {
            self.end_budget(id);
        }
    }

    /// The thread waits.
    pub(super) fn end_budget(&mut self, id: usize) {
        let now = self.now;
        let state = &mut self.states[id];
        let Some(budget) = &mut state.budget else {
            return;
        };
        budget.block(now, state.cpu_clock, NO_GAPS);
        self.consider(id);
        if self.by_timer() {
            self.pull_in_others(id);
        }
    }

    /// A budgeted thread has left the CPU: checks that were put off for want of progress are due
    /// at their exact time again.
    fn pull_in_others(&mut self, id: usize) {
        for other in 0..self.states.len() {
            let now = self.now;
            if other != id
                && let Some(budget) = &mut self.states[other].budget
                && budget.pull_in(now)
            {
                self.set_check(other);
            }
        }
    }

    /// Until when a running thread may go on from `start` without anyone looking.
    pub(super) fn limit_of(&self, id: usize, start: Nanos) -> Nanos {
        let state = &self.states[id];
        if let Some(cbs) = &state.cbs {
            return self.timer_time(start.saturating_add(cbs.runtime_left()));
        }
        match self.funds(id) {
            Some(funds) => self.timer_time(start.saturating_add(funds)),
            None => Nanos::MAX,
        }
    }

    /// CPU time that a thread at the high level may still consume, if a kernel watches the budget.
    fn funds(&self, id: usize) -> Option<Nanos> {
        let state = &self.states[id];
        let budget = state.budget.as_ref()?;
        if self.by_timer() || budget.level() == Level::Low || !budget.is_runnable() {
            return None;
        }
        let used = state.cpu_clock - budget.last_reading().0;
        Some(budget.server().available(self.now).saturating_sub(used))
    }

    /// Records what budgets have left, where that has changed.
    pub(super) fn note_budgets(&mut self) {
        if self.trace.is_none() {
            return;
        }
        for id in 0..self.states.len() {
            let state = &self.states[id];
            let Some(budget) = &state.budget else {
                continue;
            };
            let Noted {
                left,
                clock,
                charged,
            } = state.noted;
            let used = |since: Nanos, charged| if charged { state.cpu_clock - since } else { 0 };
            let before = left.saturating_sub(used(clock, charged));
            let charged = budget.level() == Level::High;
            let open = used(budget.last_reading().0, charged);
            let now = budget.server().available(self.now).saturating_sub(open);
            self.states[id].noted = Noted {
                left: now,
                clock: state.cpu_clock,
                charged,
            };
            if before != left || now != before {
                self.note(id, What::Budget { left: before });
            }
            if now != before {
                self.note(id, What::Budget { left: now });
            }
        }
    }

    /// Judges each running thread whose limit is reached; true if one changed.
    pub(super) fn judge_running(&mut self) -> bool {
        if self.timer_time(self.now) != self.now {
            return false;
        }
        for cpu in 0..self.cpus.len() {
            let Some(id) = self.cpus[cpu].running else {
                continue;
            };
            if self.throttle(id) {
                return true;
            }
            if self.funds(id) == Some(0) {
                let now = self.now;
                let state = &mut self.states[id];
                if let Some(budget) = &mut state.budget {
                    let verdict = budget.judge(now, state.cpu_clock, NO_GAPS);
                    self.obey(id, verdict);
                    return true;
                }
            }
        }
        false
    }

    /// The timer that was set for `at` has expired.
    pub(super) fn check_budget(&mut self, id: usize, at: Nanos) {
        if self.states[id].check_at != Some(at) {
            return;
        }
        self.states[id].check_at = None;
        if let Enforcement::Timer { cost, .. } = self.system.platform.enforcement {
            self.stall(id, cost);
        }
        let now = self.now;
        let state = &mut self.states[id];
        state.out.checks += 1;
        if let Some(budget) = &mut state.budget {
            let verdict = budget.judge(now, state.cpu_clock, NO_GAPS);
            self.obey(id, verdict);
        }
    }

    /// Carries out a verdict and sets the next check.
    fn obey(&mut self, id: usize, verdict: Verdict) {
        let now = self.now;
        let state = &mut self.states[id];
        if let (Some(level), Some(budget)) = (verdict.change, &mut state.budget) {
            let overrun = budget.applied(level, now, state.cpu_clock);
            let overrun = overrun.and_then(|ns| Nanos::try_from(ns).ok()).unwrap_or(0);
            state.out.worst_overrun = state.out.worst_overrun.max(overrun);
            self.note(id, What::Level(level));
            let end = match level {
                Level::High => End::Tail,
                Level::Low => self.system.platform.demote_to,
            };
            self.refresh(id, end);
        }
        self.set_check(id);
    }

    /// Sets the timer for what the reservation wants to be asked next.
    fn set_check(&mut self, id: usize) {
        let by_timer = self.by_timer();
        let state = &mut self.states[id];
        let Some(budget) = &state.budget else {
            return;
        };
        // A kernel needs no timer to see what the running thread consumes.
        let needed = by_timer || budget.level() == Level::Low;
        let wanted = budget.check_at().filter(|_| needed);
        if wanted == state.check_at {
            return;
        }
        state.check_at = wanted;
        if let Some(at) = wanted {
            let latency = match &self.system.platform.enforcement {
                Enforcement::Kernel => 0,
                Enforcement::Timer { latency, .. } => latency.draw(&mut state.random),
            };
            let time = self.timer_time(at.max(self.now)).saturating_add(latency);
            self.timers
                .push(core::cmp::Reverse((time, id, Timer::Check { at })));
        }
    }
}
