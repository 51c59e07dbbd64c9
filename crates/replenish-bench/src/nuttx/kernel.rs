//! The part of a NuttX kernel that decides who runs: one CPU, ticks, watchdogs, the ready list.
//!
//! ```text
//!  tick:  count ─► the running thread's policy counts ─► expired watchdogs, each may change a
//!         priority ─► that may switch threads at once ─► the thread at the head runs until the
//!         next tick, or until it sleeps
//! ```
//!
//! Three rules matter for what is measured, and are NuttX's (`sched/wdog/wd_start.c`,
//! `sched/sched/sched_setpriority.c`, `sched_addprioritized`):
//! - A watchdog set for n > 0 ticks expires after n + 1; equal times in order of setting.
//! - The thread at the head of the ready list runs; insertion goes before the first less urgent
//!   one, which presumes that the list is sorted.
//! - Changing the priority of a ready thread that does not run must move it in the list. With
//!   [`Kernel::with_stale_ready_list`] it only writes the field, as in builds without assertions
//!   from 2018-08 (e1202d2ed33) to NuttX 9.0 (554d56b8752).

use super::policy::{Arm, Effects, Nuttx};
use sporadic::{Level, Nanos};

/// Timers per thread: the paper's `CONFIG_SCHED_SPORADIC_MAXREPL`.
const POOL: usize = 100;

/// Scheduling of a thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NuttxPolicy {
    /// `SCHED_FIFO`.
    Fifo(u8),
    /// `SCHED_SPORADIC`, times in ticks.
    Sporadic {
        /// Priority during the slot.
        high: u8,
        /// Priority outside.
        low: u8,
        /// Length of the slot.
        budget: u32,
        /// Nominal distance of the slots.
        period: u32,
        /// Timers it may use, up to 100.
        max_repl: usize,
    },
}

/// The program of a thread: when the thread computes, and when it sleeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Program {
    /// Runs for ever.
    Busy,
    /// Runs for some CPU time, sleeps, and so on.
    Cycle {
        /// CPU time, in ns.
        run: Nanos,
        /// Ticks asked for; one more passes, counted from the last tick.
        sleep: u32,
    },
    /// Runs until that tick, then waits for ever: the thread that creates the others.
    Until(u32),
}

/// A thread and when it is created.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NuttxThread {
    /// The scheduling policy of the thread.
    pub policy: NuttxPolicy,
    /// The work of the thread.
    pub program: Program,
    /// The tick of the thread's creation. The slots of the thread start there.
    pub created: u32,
}

struct Task {
    policy: NuttxPolicy,
    program: Program,
    server: Option<Box<Nuttx<POOL>>>,
    priority: u8,
    listed: bool,
    created: u32,
    /// CPU time to the end of the current run.
    left: Nanos,
    cpu: Nanos,
    cpu_high: Nanos,
    cycles: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Watchdog {
    Slot(usize, usize),
    Wake(usize),
}

/// One simulated machine. Deterministic.
pub struct Kernel {
    tick: Nanos,
    now: u32,
    stale_list: bool,
    tasks: Vec<Task>,
    /// Most urgent first, supposedly; the first one runs.
    ready: Vec<usize>,
    /// By time, equal times in order of setting.
    watchdogs: Vec<(u32, Watchdog)>,
}

impl Kernel {
    /// A machine with a tick of `tick` ns (at least 1) and these threads, before tick 0.
    pub fn new(tick: Nanos, threads: &[NuttxThread]) -> Self {
        let tasks = threads.iter().map(|thread| {
            let (priority, server) = match thread.policy {
                NuttxPolicy::Fifo(priority) => (priority, None),
                NuttxPolicy::Sporadic {
                    high,
                    budget,
                    period,
                    max_repl,
                    ..
                } => {
                    let server = Nuttx::new(budget, period, max_repl);
                    (high, Some(Box::new(server)))
                }
            };
            Task {
                policy: thread.policy,
                program: thread.program,
                server,
                priority,
                listed: false,
                created: thread.created,
                left: match thread.program {
                    Program::Cycle { run, .. } => run.max(1),
                    Program::Busy | Program::Until(_) => Nanos::MAX,
                },
                cpu: 0,
                cpu_high: 0,
                cycles: 0,
            }
        });
        let mut kernel = Self {
            tick: tick.max(1),
            now: 0,
            stale_list: false,
            tasks: tasks.collect(),
            ready: Vec::new(),
            watchdogs: Vec::new(),
        };
        kernel.create_due();
        kernel
    }

    /// Bug 1: the ready list is not kept sorted.
    #[must_use]
    pub fn with_stale_ready_list(mut self, stale: bool) -> Self {
        self.stale_list = stale;
        self
    }

    /// Bug 2: see [`Nuttx::with_reversed_subtraction`]. Set it before the first tick.
    #[must_use]
    pub fn with_reversed_subtraction(mut self, reversed: bool) -> Self {
        for task in &mut self.tasks {
            if let Some(server) = task.server.take() {
                task.server = Some(Box::new(server.with_reversed_subtraction(reversed)));
            }
        }
        self
    }

    /// The number of ticks so far.
    pub fn now(&self) -> u32 {
        self.now
    }

    /// CPU time of a thread in ns: in all, and at its high priority.
    pub fn cpu(&self, thread: usize) -> (Nanos, Nanos) {
        self.tasks
            .get(thread)
            .map_or((0, 0), |task| (task.cpu, task.cpu_high))
    }

    /// Runs of a [`Program::Cycle`] that ended.
    pub fn cycles(&self, thread: usize) -> u64 {
        self.tasks.get(thread).map_or(0, |task| task.cycles)
    }

    /// Runs to the given tick, its handling included.
    pub fn run_until(&mut self, tick: u32) {
        while self.now < tick {
            self.run_to_next_tick();
            self.now += 1;
            self.on_tick();
        }
    }

    fn run_to_next_tick(&mut self) {
        let mut rest = self.tick;
        while rest > 0 {
            let Some(&id) = self.ready.first() else {
                return;
            };
            let task = &mut self.tasks[id];
            let span = task.left.min(rest);
            rest -= span;
            task.cpu += span;
            let high = match task.policy {
                NuttxPolicy::Sporadic { high, .. } => task.priority == high,
                NuttxPolicy::Fifo(_) => true,
            };
            task.cpu_high += if high { span } else { 0 };
            if task.left != Nanos::MAX {
                task.left -= span;
            }
            if task.left == 0 {
                self.end_run(id);
            }
        }
    }

    fn end_run(&mut self, id: usize) {
        let task = &mut self.tasks[id];
        task.cycles += 1;
        if let Program::Cycle { run, sleep } = task.program {
            task.left = run.max(1);
            if sleep > 0 {
                self.set_watchdog(sleep.cast_signed(), Watchdog::Wake(id));
                self.change_list(|kernel| kernel.unlist(id));
            }
        }
    }

    fn on_tick(&mut self) {
        if let Some(&id) = self.ready.first()
            && let Some(server) = &mut self.tasks[id].server
        {
            server.tick();
        }
        while let Some(&(due, watchdog)) = self.watchdogs.first()
            && due <= self.now
        {
            self.watchdogs.remove(0);
            match watchdog {
                Watchdog::Wake(id) => self.change_list(|kernel| kernel.list(id)),
                Watchdog::Slot(id, slot) => {
                    if let Some(server) = &mut self.tasks[id].server {
                        let effects = server.expire(slot, self.now);
                        self.apply(id, effects);
                    }
                }
            }
        }
        self.create_due();
        for id in 0..self.tasks.len() {
            if self.tasks[id].program == Program::Until(self.now) {
                self.change_list(|kernel| kernel.unlist(id));
            }
        }
    }

    fn create_due(&mut self) {
        for id in 0..self.tasks.len() {
            if self.tasks[id].created != self.now {
                continue;
            }
            if let Some(server) = &mut self.tasks[id].server {
                let effects = server.start(self.now);
                self.apply(id, effects);
            }
            self.change_list(|kernel| kernel.list(id));
        }
    }

    /// Starts the timers, then sets the level.
    fn apply(&mut self, id: usize, effects: Effects) {
        for Arm { slot, delay } in effects.arm.into_iter().flatten() {
            let watchdog = Watchdog::Slot(id, slot);
            self.watchdogs.retain(|&(_, other)| other != watchdog);
            self.set_watchdog(delay, watchdog);
        }
        let NuttxPolicy::Sporadic { high, low, .. } = self.tasks[id].policy else {
            return;
        };
        match effects.level {
            Some(Level::High) => self.set_priority(id, high),
            Some(Level::Low) => self.set_priority(id, low),
            None => {}
        }
    }

    fn set_watchdog(&mut self, delay: i32, watchdog: Watchdog) {
        let Ok(delay) = u32::try_from(delay) else {
            return; // -EINVAL, which nobody looks at
        };
        let due = self.now + if delay == 0 { 1 } else { delay + 1 };
        let at = self.watchdogs.partition_point(|&(other, _)| other <= due);
        self.watchdogs.insert(at, (due, watchdog));
    }

    fn set_priority(&mut self, id: usize, priority: u8) {
        if !self.tasks[id].listed {
            self.tasks[id].priority = priority;
            return;
        }
        let running = self.ready.first().copied();
        let moves = if running == Some(id) {
            let next = self.ready.get(1);
            next.is_some_and(|&next| priority <= self.tasks[next].priority)
        } else {
            !self.stale_list || running.is_some_and(|r| priority > self.tasks[r].priority)
        };
        if moves {
            self.change_list(|kernel| {
                kernel.unlist(id);
                kernel.tasks[id].priority = priority;
                kernel.list(id);
            });
        } else {
            self.tasks[id].priority = priority;
        }
    }

    /// Changes the ready list and tells both threads if another one runs now.
    fn change_list(&mut self, change: impl FnOnce(&mut Self)) {
        let before = self.ready.first().copied();
        change(self);
        let after = self.ready.first().copied();
        if before == after {
            return;
        }
        if let Some(server) = before.and_then(|id| self.tasks[id].server.as_mut()) {
            server.suspend(self.now);
        }
        if let Some(id) = after
            && let Some(server) = &mut self.tasks[id].server
        {
            let effects = server.resume(self.now);
            self.apply(id, effects);
        }
    }

    fn list(&mut self, id: usize) {
        let priority = self.tasks[id].priority;
        let less_urgent = |&other: &usize| self.tasks[other].priority < priority;
        let at = self.ready.iter().position(less_urgent);
        self.ready.insert(at.unwrap_or(self.ready.len()), id);
        self.tasks[id].listed = true;
    }

    fn unlist(&mut self, id: usize) {
        self.ready.retain(|&other| other != id);
        self.tasks[id].listed = false;
    }
}
