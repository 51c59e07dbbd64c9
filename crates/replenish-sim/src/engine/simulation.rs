//! The loop, and what it holds.
//!
//! ```text
//!            ┌───────────────────────────── settle ─────────────────────────────┐
//!   events ─►│ assign the most urgent ready threads to CPUs                      │
//!   at now   │ a running thread whose CPU time is used up does its next step     │─► next time:
//!            │ a running thread whose budget is used up is judged                │   event, end of
//!            └──────────────── until nothing changes ───────────────────────────┘   a step, budget
//!                 ▲                                                                      │
//!                 └────────────── all running threads consume until then ◄───────────────┘
//! ```
//!
//! A thread:
//!
//! ```text
//!            release            dispatched                 Block / Lock held
//!     Idle ──────────► Ready ◄─────────────► on a CPU ─────────────────────────► Blocked
//!      ▲                 ▲      preempted        │                               LockWait
//!      │                 └───────────────────────┼──────────────────────────────────┘
//!      └──────────── job ends, queue empty ──────┘        wakes / gets the lock
//! ```

use super::ready::Ready;
use super::state::{Cpu, Lock, State};
use super::{Options, SimError};
use crate::{Event, Nanos, Outcome, SpecError, System, What};
use core::cmp::Reverse;
use std::collections::BinaryHeap;

/// Steps without CPU time that may happen at one instant before a run is given up.
const LIVELOCK: u32 = 100_000;

/// Runs `system` from time 0, when all threads wait and all budgets are full, to the horizon.
///
/// Releases at the horizon no longer count; jobs that end there do. Time taken and memory grow
/// with the number of events in the run.
///
/// # Errors
/// [`SimError`]: the system is not valid, too long to be simulated, or it cannot go on.
pub fn simulate(system: &System, options: &Options) -> Result<Outcome, SimError> {
    system.check()?;
    system.check_until(options.horizon)?;
    let mut sim = Sim::new(system, options)?;
    sim.run()?;
    Ok(sim.finish())
}

/// The action of a timer. The order is that of events at one time of one thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Timer {
    /// The budget of a thread is looked at; stale unless set for `at`.
    Check { at: Nanos },
    /// `SCHED_DEADLINE` gives runtime; stale unless set for `at`.
    Unthrottle { at: Nanos },
    /// A [`Step::Block`](crate::Step::Block) ends.
    BlockEnd,
    /// A release, counted from `arrival`.
    Release { arrival: Nanos },
}

pub(super) struct Sim<'a> {
    pub(super) system: &'a System,
    pub(super) horizon: Nanos,
    pub(super) now: Nanos,
    pub(super) states: Vec<State<'a>>,
    pub(super) ready: Ready,
    pub(super) locks: Vec<Lock>,
    pub(super) cpus: Vec<Cpu>,
    pub(super) timers: BinaryHeap<Reverse<(Nanos, usize, Timer)>>,
    /// The next assignment of threads to CPUs; kept to save allocations.
    pub(super) assigned: Vec<Option<usize>>,
    pub(super) trace: Option<Vec<Event>>,
    /// A circle of locks was closed by this thread.
    pub(super) deadlock: Option<usize>,
}

impl<'a> Sim<'a> {
    fn new(system: &'a System, options: &Options) -> Result<Self, SimError> {
        let mut states = Vec::with_capacity(system.threads.len());
        for (id, thread) in system.threads.iter().enumerate() {
            let state = State::new(thread, &system.platform, options.seed, id);
            states.push(state.map_err(|message| SpecError {
                thread: Some(thread.name.clone()),
                message,
            })?);
        }
        let mut sim = Self {
            system,
            horizon: options.horizon,
            now: 0,
            states,
            ready: Ready::default(),
            locks: (0..system.locks).map(|_| Lock::default()).collect(),
            cpus: vec![Cpu::default(); system.cpus],
            timers: BinaryHeap::new(),
            assigned: vec![None; system.cpus],
            trace: options.trace.then(Vec::new),
            deadlock: None,
        };
        for id in 0..sim.states.len() {
            sim.refresh(id, crate::End::Tail);
            sim.schedule_release(id, None);
        }
        Ok(sim)
    }

    fn run(&mut self) -> Result<(), SimError> {
        loop {
            // Jobs that end now have ended, and threads that have used up their budgets are
            // judged, before a timer of now can come between.
            if self.cpus.iter().any(|cpu| self.has_ended(cpu).is_some()) {
                self.settle()?;
            }
            while self.judge_running() {}
            self.fire_timers();
            self.settle()?;
            self.note_budgets();
            let next = self.next_time();
            if next > self.horizon {
                self.advance(self.horizon);
                self.note_budgets();
                return Ok(());
            }
            self.advance(next);
        }
    }

    /// Handles every timer that is due.
    fn fire_timers(&mut self) {
        while let Some(&Reverse((time, id, timer))) = self.timers.peek()
            && time <= self.now
        {
            self.timers.pop();
            match timer {
                Timer::Release { arrival } => self.timed_release(id, arrival),
                Timer::BlockEnd => self.wake(id),
                Timer::Check { at } => self.check_budget(id, at),
                Timer::Unthrottle { at } => self.unthrottle(id, at),
            }
        }
    }

    /// Lets everything happen that happens at this instant.
    fn settle(&mut self) -> Result<(), SimError> {
        let mut steps = 0;
        loop {
            self.reschedule();
            if let Some(id) = self.cpus.iter().find_map(|cpu| self.has_ended(cpu)) {
                steps += 1;
                if steps > LIVELOCK {
                    return Err(SimError::Livelock {
                        time: self.now,
                        thread: self.system.threads[id].name.clone(),
                    });
                }
                self.progress(id);
                if let Some(id) = self.deadlock {
                    return Err(SimError::Deadlock {
                        time: self.now,
                        thread: self.system.threads[id].name.clone(),
                    });
                }
            } else if !self.judge_running() {
                return Ok(());
            }
        }
    }

    /// The thread on this CPU, if it has consumed what its step asked for.
    fn has_ended(&self, cpu: &Cpu) -> Option<usize> {
        let free = cpu.stalled_until <= self.now;
        cpu.running.filter(|&id| free && self.states[id].left == 0)
    }

    /// Time at which something can happen next.
    fn next_time(&self) -> Nanos {
        let timer = self.timers.peek().map_or(Nanos::MAX, |t| t.0.0);
        let running = self.cpus.iter().filter_map(|cpu| {
            let id = cpu.running?;
            let start = self.now.max(cpu.stalled_until);
            let end = start.saturating_add(self.states[id].left);
            Some(end.min(self.limit_of(id, start)))
        });
        running.fold(timer, Nanos::min)
    }

    /// Time passes, up to `to`: running threads consume.
    fn advance(&mut self, to: Nanos) {
        for cpu in &mut self.cpus {
            let from = cpu.stalled_until.clamp(self.now, to);
            cpu.overhead += from - self.now;
            match cpu.running {
                Some(id) => self.states[id].consume(to - from),
                None => cpu.idle += to - from,
            }
        }
        self.now = to;
    }

    /// The first time from `time` on at which a timer can act.
    pub(super) fn timer_time(&self, time: Nanos) -> Nanos {
        match self.system.platform.tick {
            Some(tick) => time.div_ceil(tick).saturating_mul(tick),
            None => time,
        }
    }

    pub(super) fn set_timer(&mut self, time: Nanos, id: usize, timer: Timer) {
        let time = self.timer_time(time);
        self.timers.push(Reverse((time, id, timer)));
    }

    /// The CPU that handles timers of this thread does so for `cost`, instead of running anyone.
    pub(super) fn stall(&mut self, id: usize, cost: Nanos) {
        let at = self.system.threads[id].cpu.or(self.states[id].on);
        let cpu = &mut self.cpus[at.unwrap_or(0)];
        cpu.stalled_until = cpu.stalled_until.max(self.now).saturating_add(cost);
    }

    pub(super) fn note(&mut self, thread: usize, what: What) {
        if let Some(trace) = &mut self.trace {
            trace.push(Event {
                time: self.now,
                thread,
                what,
            });
        }
    }

    fn finish(mut self) -> Outcome {
        let now = self.now;
        Outcome {
            horizon: self.horizon,
            threads: self.states.iter_mut().map(|s| s.finish(now)).collect(),
            idle: self.cpus.iter().map(|cpu| cpu.idle).collect(),
            overhead: self.cpus.iter().map(|cpu| cpu.overhead).collect(),
            trace: self.trace.unwrap_or_default(),
        }
    }
}
