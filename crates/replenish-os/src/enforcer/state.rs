//! The state that an enforcer's thread and its workers' accounts share, and the thread's loop.

use super::config::{Enforcement, EnforcerConfig, EnforcerStats, NEVER};
use super::enforced_thread::{EnforcedThread, JudgeOutcome};
use crate::Nanos;
use crate::backend::clock;
use crate::backend::timer::TimerFd;
use crate::pi_mutex::PiMutex;
use alloc::vec::Vec;
use core::sync::atomic::{AtomicBool, Ordering};

/// One enforcer, as its thread, its workers and the readers of their accounts share it.
#[derive(Debug)]
pub(super) struct EnforcerState {
    pub(super) threads: PiMutex<EnforcedThreads>,
    pub(super) timer: Option<TimerFd>,
    pub(super) stop: AtomicBool,
    pub(super) mode: Enforcement,
    pub(super) config: EnforcerConfig,
}

/// The enrolled threads and the timer that serves them.
#[derive(Debug)]
pub(super) struct EnforcedThreads {
    pub(super) enrolled: Vec<EnforcedThread>,
    /// The time that the timer is set to, [`NEVER`] if it is not.
    armed: Nanos,
    pub(super) stats: EnforcerStats,
}

impl EnforcerState {
    pub(super) fn new(config: EnforcerConfig, mode: Enforcement, timer: Option<TimerFd>) -> Self {
        let threads = EnforcedThreads {
            enrolled: Vec::with_capacity(config.capacity.clamp(1, 1024)),
            armed: NEVER,
            stats: EnforcerStats::default(),
        };
        Self {
            threads: PiMutex::new(threads),
            timer,
            stop: AtomicBool::new(false),
            mode,
            config,
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
                continue; // interrupted by a signal
            }
            let mut threads = self.threads.lock();
            threads.armed = NEVER;
            threads.stats.wakes += 1;
            if !self.sweep(&mut threads) {
                threads.stats.idle_wakes += 1;
            }
            self.rearm(&mut threads);
        }
    }

    /// Judges every thread whose check is due; returns whether any level changed.
    ///
    /// On the workers' own CPU none of them runs before this is over. So one reading of the time
    /// serves all, and what the sweep itself took is added to every check at the end: a worker
    /// has lost it, and a check that ignored it would come early.
    fn sweep(&self, threads: &mut EnforcedThreads) -> bool {
        let now = clock::monotonic();
        let (mut changed, mut refused) = (0, 0);
        for thread in &mut threads.enrolled {
            if thread.is_due(now, self.config.tuning.slack) {
                match thread.judge(now, self.mode) {
                    JudgeOutcome::Unchanged => {}
                    JudgeOutcome::Changed => changed += 1,
                    JudgeOutcome::Refused => refused += 1,
                }
            }
        }
        threads.stats.changes += changed;
        threads.stats.refused += refused;
        if changed > 0 {
            threads.pull_in(now);
        }
        if self.mode == Enforcement::SameCpu {
            let took = clock::monotonic().saturating_sub(now);
            threads
                .enrolled
                .iter_mut()
                .for_each(|thread| thread.postpone(took));
        }
        changed > 0
    }

    /// Arms the timer for the earliest check.
    fn rearm(&self, threads: &mut EnforcedThreads) {
        let timer = self.timer.as_ref();
        let mut at = NEVER;
        for thread in &threads.enrolled {
            at = at.min(thread.timer_at(timer));
        }
        if at != NEVER {
            let floor = clock::monotonic().saturating_add(self.config.tuning.min_rearm);
            self.arm(threads, at.max(floor));
        }
    }

    /// Makes sure that the timer fires at `at` or earlier.
    pub(super) fn arm(&self, threads: &mut EnforcedThreads, at: Nanos) {
        let Some(timer) = &self.timer else { return };
        if at < threads.armed && timer.arm(at).is_ok() {
            threads.armed = at;
        }
    }
}

impl EnforcedThreads {
    /// A worker left the CPU: those that waited for it are judged at their exact times again.
    /// Returns the earliest time that moved, [`NEVER`] if none did.
    pub(super) fn pull_in(&mut self, now: Nanos) -> Nanos {
        let mut at = NEVER;
        for thread in &mut self.enrolled {
            at = at.min(thread.pull_in(now));
        }
        at
    }
}
