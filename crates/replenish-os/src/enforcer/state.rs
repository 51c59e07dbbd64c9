//! The state that an enforcer's thread and its workers' accounts share, and the thread's loop.

use super::alarm::Alarm;
use super::config::{Enforcement, EnforcerConfig, EnforcerStats, NEVER};
use super::enforced_thread::{EnforcedThread, JudgeOutcome};
use super::views::Views;
use crate::Nanos;
use crate::backend::OsError;
use crate::backend::clock;
use crate::backend::timer::TimerFd;
use crate::pi_mutex::PiMutex;
use alloc::vec::Vec;
use core::sync::atomic::{AtomicBool, Ordering};
use sporadic::{earliest, later, latest, since};

/// One enforcer, as its thread, its workers and the readers of their accounts share it.
#[derive(Debug)]
pub(super) struct EnforcerState {
    pub(super) threads: PiMutex<EnforcedThreads>,
    pub(super) timer: Option<TimerFd>,
    pub(super) stop: AtomicBool,
    pub(super) mode: Enforcement,
    pub(super) config: EnforcerConfig,
    pub(super) views: Views,
}

/// Changes of level in one sweep.
#[derive(Default)]
struct Changes {
    changed: u64,
    refused: u64,
}

impl Changes {
    const fn count(&mut self, outcome: JudgeOutcome) {
        match outcome {
            JudgeOutcome::Unchanged => {}
            JudgeOutcome::Changed => self.changed += 1,
            JudgeOutcome::Refused => self.refused += 1,
        }
    }
}

/// The enrolled threads and the timer that serves them.
#[derive(Debug)]
pub(super) struct EnforcedThreads {
    pub(super) enrolled: Vec<EnforcedThread>,
    alarm: Alarm,
    pub(super) stats: EnforcerStats,
}

impl EnforcerState {
    pub(super) fn new(config: EnforcerConfig, mode: Enforcement, timer: Option<TimerFd>) -> Self {
        let most = config.capacity.clamp(1, 1024);
        let threads = EnforcedThreads {
            enrolled: Vec::with_capacity(most),
            alarm: Alarm::new(),
            stats: EnforcerStats::default(),
        };
        Self {
            threads: PiMutex::new(threads),
            timer,
            stop: AtomicBool::new(false),
            mode,
            config,
            views: Views::new(most),
        }
    }

    pub(super) fn is_deferred(&self) -> bool {
        cfg!(not(target_os = "none")) && self.mode == Enforcement::Deferred
    }

    /// The enforcer thread. Nothing in here allocates.
    pub(super) fn run(&self) {
        let Some(timer) = &self.timer else { return };
        while !self.stop.load(Ordering::SeqCst) {
            if timer.read().is_err() {
                return; // for good: signals are no error. It would come back at once, for ever.
            }
            let mut threads = self.threads.lock();
            threads.alarm.fired();
            threads.stats.wakes += 1;
            if !self.sweep(&mut threads, self.mode) {
                threads.stats.idle_wakes += 1;
            }
        }
    }

    /// Judges every thread whose check is due, and arms the timer for the earliest check; returns
    /// whether any level changed.
    ///
    /// From the workers' own CPU (`mode`) none of them runs before this is over. So one reading of
    /// the time serves all, and the time of the sweep itself is added to every check at the end. A
    /// worker has lost that time, and a check that ignored it would come early.
    pub(super) fn sweep(&self, threads: &mut EnforcedThreads, mode: Enforcement) -> bool {
        let now = clock::monotonic();
        let mut changes = Changes::default();
        let mut waiting = false;
        for thread in &mut threads.enrolled {
            if thread.is_due(now, self.config.tuning.slack) {
                if mode == Enforcement::SameCpu && thread.waits_funded(now) {
                    waiting = true;
                } else {
                    changes.count(thread.judge(now, mode));
                }
            }
        }
        // A change gives the CPU to one of them, and each has its check anew below.
        if waiting && changes.changed == 0 {
            for thread in &mut threads.enrolled {
                if thread.is_due(now, self.config.tuning.slack) && thread.waits_funded(now) {
                    changes.count(thread.judge(now, mode));
                }
            }
        }
        let Changes { changed, refused } = changes;
        threads.stats.changes += changed;
        threads.stats.refused += refused;
        let over = clock::monotonic();
        let took = match mode {
            Enforcement::SameCpu => since(over, now),
            Enforcement::OtherCpu | Enforcement::Deferred => 0,
        };
        // One pass: each thread's state is in cache lines of its own.
        let mut at = NEVER;
        for thread in &mut threads.enrolled {
            if changed > 0 {
                thread.pull_in(now);
                if mode == Enforcement::SameCpu {
                    thread.catch_up(now);
                }
            }
            thread.postpone(took);
            at = earliest(at, thread.timer_at(self.timer.as_ref()));
        }
        let floor = later(over, self.config.tuning.min_rearm);
        self.arm(threads, latest(at, floor));
        changed > 0
    }

    /// Fires the timer at once. Under the lock, so that no worker sets it to a later time before
    /// the enforcer has read it.
    pub(super) fn fire_now(&self) -> Result<(), OsError> {
        let Some(timer) = &self.timer else {
            return Ok(());
        };
        // A time in the past, before any check.
        self.threads.lock().alarm.set(1, |at| timer.arm(at))
    }

    /// Makes sure that the timer fires at `at` or earlier, and tells the watchdog.
    pub(super) fn arm(&self, threads: &mut EnforcedThreads, at: Nanos) {
        let Some(timer) = &self.timer else { return };
        let armed = threads.alarm.set(at, |at| timer.arm(at));
        // Refused, it is late, and the watchdog finds that.
        let due = armed.map_or(at, |()| threads.alarm.time());
        self.views.set_due(due);
    }
}

impl EnforcedThreads {
    /// A worker left the CPU: those that waited for it are judged at their exact times again.
    /// Returns the earliest time that moved, [`NEVER`] if none did.
    pub(super) fn pull_in(&mut self, now: Nanos) -> Nanos {
        let mut at = NEVER;
        for thread in &mut self.enrolled {
            at = earliest(at, thread.pull_in(now));
        }
        at
    }
}

#[cfg(all(test, target_os = "linux", not(nuttx_host), not(loom)))]
mod tests;
