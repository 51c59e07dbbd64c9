//! The worker's side of enforcement.

use super::budgeted::{Budgeted, Stopped};
use super::config::{AnyServer, EnrollError, MAX_REPL};
use super::enforced_thread::EnforcedThread;
use super::meter::{Meter, MeterState};
use super::state::EnforcerState;
use crate::backend::blocking_detector::BlockingDetector;
use crate::backend::clock::{self, ThreadCpuClock};
use crate::backend::suspend::SuspendCell;
use crate::backend::tid::current_tid;
use crate::pi_mutex::PiMutex;
use crate::{Arc, Nanos, Notify, Tid};
use alloc::boxed::Box;
use core::sync::atomic::{AtomicBool, Ordering};
use sporadic::{Kind, Low, Params, Reservation};

/// The account of one worker thread; owned and called by that thread alone.
///
/// ```text
///   loop {
///       wait for work; activate();
///       for each callback { callback_begin()?; run; callback_end() }
///       block()
///   }
/// ```
///
/// A worker without a budget has an account, too ([`Account::unbudgeted`]): it only tells CPU time.
#[derive(Debug)]
pub struct Account {
    meter: Meter,
    switches_seen: u64,
}

impl Account {
    /// An account for the calling thread that has no budget to hold.
    #[must_use]
    pub fn unbudgeted() -> Self {
        Self::over(current_tid(), None)
    }

    #[inline(never)] // what it moves about would stay on the stack of the worker
    pub(super) fn enroll(
        enforcer: &Arc<EnforcerState>,
        params: &Params,
        kind: Kind,
    ) -> Result<Self, EnrollError> {
        let config = &enforcer.config;
        if !enforcer.is_deferred() && params.priority() >= config.priority {
            return Err(EnrollError::PriorityTooHigh {
                worker: params.priority(),
                enforcer: config.priority,
            });
        }
        let tid = current_tid();
        let now = clock::monotonic();
        params
            .check_capacity(MAX_REPL)
            .map_err(EnrollError::Params)?;
        let cpu = clock::thread_cpu();
        // Without the records callback_end() takes a reading after each callback that blocked.
        let (detector, records_refused) =
            BlockingDetector::new(tid, config.switch_log, config.capacity);
        let has_switch_records = detector.is_exact();
        let lock_waits = detector.lock_waits();
        let suspends = params.low() == Low::Suspend && !enforcer.is_deferred();
        // The thread keeps it, enrolled or refused: nothing else points to it from its side.
        let suspend = Arc::new(SuspendCell::new());
        if suspends {
            suspend.attach_current_thread().map_err(EnrollError::Os)?;
        }
        let overruns = Box::default();
        let index = {
            let mut threads = enforcer.threads.lock();
            let (index, capacity) = (threads.enrolled.len(), threads.enrolled.capacity());
            if index == capacity {
                return Err(EnrollError::Full { capacity });
            }
            // Made where it is to stay: it is large.
            let server = AnyServer::clamped(kind, *params, now).with_min_chunk(config.tuning.slack);
            let tuning = if cfg!(target_os = "none") {
                config.tuning // a wake-up costs little there, and 64-bit division much flash
            } else {
                config.tuning.for_budget(params.budget())
            };
            let reservation = Reservation::new(server, tuning, now, cpu);
            let cell = Arc::clone(&suspend);
            let thread = EnforcedThread::new(reservation, tid, detector, cell, overruns);
            thread.supervised.show(&enforcer.views, index);
            threads.enrolled.push(thread);
            index
        };
        let wake = Notify::new();
        let cancelled = AtomicBool::new(false);
        let enforcer = Arc::clone(enforcer);
        let budget = Budgeted {
            enforcer,
            index,
            wake,
            suspend,
            cancelled,
            has_switch_records,
            records_refused,
            lock_waits,
        };
        Ok(Self::over(tid, Some(budget)))
    }

    fn over(tid: Tid, budget: Option<Budgeted>) -> Self {
        let clock = ThreadCpuClock::of(tid);
        let inner = MeterState {
            tid,
            clock,
            ended: AtomicBool::new(false),
            last_cpu: PiMutex::new(0),
            budget,
        };
        Self {
            meter: Meter(Arc::new(inner)),
            switches_seen: 0,
        }
    }

    /// A reader of this account.
    #[must_use]
    pub fn meter(&self) -> Meter {
        self.meter.clone()
    }

    /// Whether there is a budget to account for: without one, [`activate`](Self::activate) and
    /// [`block`](Self::block) do nothing, and the time need not be looked up for them.
    #[inline]
    #[must_use]
    pub fn has_budget(&self) -> bool {
        self.meter.0.budget.is_some()
    }

    /// The worker leaves its wait: call right after it woke up with work to do. `woken` is when
    /// the work arrived ([`clock::monotonic`]): if the worker then had to wait for the CPU, its
    /// budget still comes back a period after `woken`, as the rules say.
    #[inline]
    pub fn activate(&mut self, woken: Nanos) {
        if let Some(b) = &self.meter.0.budget {
            b.activate(woken);
        }
    }

    /// The worker is about to wait: call when there is nothing left to do.
    #[inline]
    pub fn block(&mut self) {
        if let Some(b) = &self.meter.0.budget {
            b.block();
        }
    }

    /// Before each callback. Where an exhausted worker is suspended or deferred, this waits for
    /// the replenishment; otherwise it returns at once.
    ///
    /// # Errors
    /// [`Stopped`] when [`Meter::cancel`] was called meanwhile.
    #[inline]
    pub fn callback_begin(&mut self) -> Result<(), Stopped> {
        match &self.meter.0.budget {
            Some(b) => b.begin(&mut self.switches_seen),
            None => Ok(()),
        }
    }

    /// After each callback: notices that it blocked inside, where the kernel keeps no records.
    #[inline]
    pub fn callback_end(&mut self) {
        if let Some(b) = &self.meter.0.budget {
            b.end(self.switches_seen);
        }
    }
}

impl Drop for Account {
    /// Takes the last reading while the thread still has a clock; its record stays for the readers.
    fn drop(&mut self) {
        let inner = &self.meter.0;
        *inner.last_cpu.lock() = inner.clock.read().unwrap_or(0);
        inner.ended.store(true, Ordering::Release);
        self.meter.abandon();
        if let Some(b) = &inner.budget {
            b.suspend.detach();
        }
    }
}
