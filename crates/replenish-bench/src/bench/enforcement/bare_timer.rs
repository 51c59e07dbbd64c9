//! The least that an enforcer can cost: its system calls at its times, with nothing decided.
//!
//! A thread ends the "budgets" of spinning threads one after another by wall time and raises all of
//! them once per period, as the enforcer does for workers that always want more. Its CPU time is
//! the kernel's share of the enforcer's CPU time on this machine: a wake, a reading of a CPU clock,
//! two changes of priority, a timer.

use super::schedule::{Schedule, WORKER_PRIORITY};
use crate::load::Nanos;
use crate::load::spec::{BACKGROUND, ENFORCER_PRIORITY};
use replenish_cli::outcome::Failure;
use replenish_cli::signals::Stop;
use replenish_os::timer::TimerFd;
use replenish_os::{
    Policy, Thread, ThreadSpec, Tid, clock, current_tid, demote_to_tail, promote, spawn,
};
use std::fmt::Display;
use std::io;

/// The thread that makes the calls, and the spinning threads it makes them on.
pub(super) struct BareTimer {
    spinners: Vec<Thread<()>>,
    thread: Thread<io::Result<Used>>,
}

/// CPU time of the bare thread.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct Used {
    /// CPU time inside the windows.
    pub cpu: Nanos,
    /// The time that the windows took.
    pub time: Nanos,
    /// Wakes inside the windows.
    pub wakes: u64,
}

impl BareTimer {
    /// Starts `count` spinning threads on `cpu`, each with `budget` of wall time per `period`.
    pub(super) fn start(
        cpu: usize,
        count: usize,
        budget: Nanos,
        period: Nanos,
        schedule: Schedule,
        stop: &Stop,
    ) -> Result<Self, Failure> {
        let spec = |name: String, priority| {
            Policy::fifo(priority)
                .map(|policy| ThreadSpec::new(name).policy(policy).cpu(cpu))
                .map_err(|e| failed(&e))
        };
        let mut spinners = Vec::new();
        for n in 0..count {
            let stopping = stop.clone();
            let body = move || {
                for window in schedule.windows() {
                    clock::sleep_until(window.start);
                    while !stopping.is_triggered() && clock::monotonic() < window.end {
                        std::hint::spin_loop();
                    }
                }
            };
            let spinner = spawn(spec(format!("bare/{n}"), WORKER_PRIORITY)?, body);
            spinners.push(spinner.map_err(|e| failed(&e))?);
        }
        let tids: Vec<Tid> = spinners.iter().map(Thread::tid).collect();
        let stopping = stop.clone();
        let body = move || make_calls(&tids, budget, period, schedule, &stopping);
        let thread = spawn(spec("bare/timer".to_owned(), ENFORCER_PRIORITY)?, body);
        let thread = thread.map_err(|e| failed(&e))?;
        Ok(Self { spinners, thread })
    }

    /// Waits for the end.
    pub(super) fn finish(self) -> Result<Used, Failure> {
        let used = self
            .thread
            .join()
            .map_err(|_| failed(&"its thread panicked"))?;
        for spinner in self.spinners {
            spinner
                .join()
                .map_err(|_| failed(&"a spinning thread panicked"))?;
        }
        used.map_err(|e| failed(&e))
    }
}

fn failed(e: &dyn Display) -> Failure {
    Failure::refused(format!("bare timer: {e}"))
}

fn make_calls(
    tids: &[Tid],
    budget: Nanos,
    period: Nanos,
    schedule: Schedule,
    stop: &Stop,
) -> io::Result<Used> {
    let timer = TimerFd::new()?;
    let own = clock::ThreadCpuClock::of(current_tid());
    let read = || own.read().unwrap_or(0);
    let mut used = Used::default();
    for window in schedule.windows() {
        clock::sleep_until(window.start);
        let before = read();
        let mut round = window.start;
        while round < window.end && !stop.is_triggered() {
            let mut at = round;
            for tid in tids {
                at += budget;
                timer.arm(at)?;
                timer.read()?;
                used.wakes += 1;
                std::hint::black_box(clock::ThreadCpuClock::of(*tid).read());
                demote_to_tail(*tid, BACKGROUND)?;
            }
            round += period;
            timer.arm(round)?;
            timer.read()?;
            used.wakes += 1;
            for tid in tids {
                promote(*tid, WORKER_PRIORITY)?;
            }
        }
        used.cpu += read().saturating_sub(before);
        used.time += window.end - window.start;
    }
    Ok(used)
}
