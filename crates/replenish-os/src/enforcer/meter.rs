//! The reader's side of enforcement: the CPU time and the overruns of one worker.

use super::budgeted::Budgeted;
use super::config::Enforcement;
use super::overruns::{OverrunSamples, OverrunSummary, summarise};
use super::usage::Usage;
use crate::backend::OsError;
use crate::backend::clock::{self, ThreadCpuClock};
use crate::backend::lock_wait::lock_from_another_thread;
use crate::backend::tid::current_tid;
use crate::pi_mutex::PiMutex;
use crate::{Arc, Nanos, Tid};
use alloc::vec::Vec;
use core::sync::atomic::{AtomicBool, Ordering};

/// Reads a worker's account from any thread, at any time; cheap to clone.
#[derive(Clone, Debug)]
pub struct Meter(pub(super) Arc<MeterState>);

#[derive(Debug)]
pub(super) struct MeterState {
    pub(super) tid: Tid,
    pub(super) clock: ThreadCpuClock,
    /// The thread's own account has ended: its id and its clock may be another thread's.
    pub(super) ended: AtomicBool,
    /// CPU time of an unbudgeted thread at that moment.
    pub(super) last_cpu: PiMutex<Nanos>,
    pub(super) budget: Option<Budgeted>,
}

impl Meter {
    /// The worker's thread.
    #[must_use]
    pub fn tid(&self) -> Tid {
        self.0.tid
    }

    /// Mode that holds the worker's budget; `None` without a budget.
    #[must_use]
    pub fn enforcement(&self) -> Option<Enforcement> {
        self.0.budget.as_ref().map(|b| b.enforcer.mode)
    }

    /// Whether blocking inside callbacks is seen exactly, through the kernel's records.
    #[must_use]
    pub fn sees_blocking(&self) -> bool {
        self.0.budget.as_ref().is_some_and(|b| b.has_switch_records)
    }

    /// The reason why blocking inside callbacks is not seen exactly although it was asked for
    /// ([`EnforcerConfig::switch_log`](crate::EnforcerConfig::switch_log)); `None` where it is.
    #[must_use]
    pub fn records_refused(&self) -> Option<&OsError> {
        self.0.budget.as_ref()?.records_refused.as_ref()
    }

    /// The worker's usage up to this moment. Takes the enforcer's lock briefly and does not
    /// allocate. Another thread than the worker tries for 2 ms before it waits in the kernel, with
    /// priority inheritance. Waiters are served by priority: a thread below the workers waits
    /// behind one that is low, has asked for the lock and gets no CPU, until its budget is back.
    #[must_use]
    #[inline]
    pub fn usage(&self) -> Usage {
        match &self.0.budget {
            Some(b) => b.usage(),
            None => Usage {
                cpu_high: self.0.cpu(),
                ..Usage::default()
            },
        }
    }

    /// Overruns of the budget, newest exhaustions first. Allocates: not for the hot path.
    #[must_use]
    pub fn overruns(&self) -> OverrunSummary {
        let Some(b) = &self.0.budget else {
            return OverrunSummary::default();
        };
        let mut sample = Vec::with_capacity(1024);
        let totals = {
            let threads = lock_from_another_thread(&b.enforcer.threads);
            let Some(thread) = threads.enrolled.get(b.index) else {
                return OverrunSummary::default();
            };
            thread.overruns.copy_into(&mut sample)
        };
        summarise(&mut sample, totals)
    }

    /// Number of demotions that were late by more than [`STALL`](super::STALL) nanoseconds. Waits
    /// for the enforcer's lock as [`usage`](Self::usage) does, and does not allocate.
    #[must_use]
    pub fn stalls(&self) -> u64 {
        let Some(b) = &self.0.budget else {
            return 0;
        };
        let threads = lock_from_another_thread(&b.enforcer.threads);
        let thread = threads.enrolled.get(b.index);
        thread.map_or(0, |thread| thread.overruns.stalls())
    }

    /// The samples behind [`overruns`](Self::overruns). Allocates: not for the hot path.
    #[must_use]
    pub fn overrun_samples(&self) -> OverrunSamples {
        let Some(b) = &self.0.budget else {
            return OverrunSamples::default();
        };
        let mut overruns = Vec::with_capacity(1024);
        let (stalls, kept) = {
            let threads = lock_from_another_thread(&b.enforcer.threads);
            let Some(thread) = threads.enrolled.get(b.index) else {
                return OverrunSamples::default();
            };
            thread.overruns.copy_into(&mut overruns);
            thread.overruns.newest_stalls()
        };
        OverrunSamples {
            overruns,
            stalls: stalls.into_iter().take(kept).collect(),
        }
    }

    /// Ends every wait for budget, now and later: the executor stops.
    pub fn cancel(&self) {
        if let Some(b) = &self.0.budget {
            b.cancelled.store(true, Ordering::Release);
            b.suspend.cancel();
            b.wake.set();
        }
    }

    /// Stops supervising a thread that does not come back from its callback. The caller decides
    /// what priority it keeps.
    pub fn abandon(&self) {
        if let Some(b) = &self.0.budget {
            b.with(|thread| {
                thread.observe(clock::monotonic());
                thread.release();
            });
        }
    }
}

impl MeterState {
    /// CPU time so far. Its own clock is cheaper for a thread than that of any other.
    fn cpu(&self) -> Nanos {
        if self.ended.load(Ordering::Acquire) {
            return *self.last_cpu.lock();
        }
        if current_tid() == self.tid {
            return clock::thread_cpu();
        }
        // The thread ends at this moment.
        self.clock.read().unwrap_or_else(|| *self.last_cpu.lock())
    }
}
