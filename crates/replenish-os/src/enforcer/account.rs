//! The worker's side of enforcement ([`Account`]) and the reader's ([`Meter`]).

use super::enforced_thread::Entry;
use super::overruns::summarise;
use super::{
    AnyServer, Enforcement, EnrollError, MAX_REPL, OverrunSamples, OverrunSummary, Shared, State,
};
use crate::Arc;
use crate::Nanos;
use crate::Notify;
use crate::Tid;
use crate::backend;
use crate::backend::blocking_detector::BlockingDetector;
use crate::backend::clock::{self, ThreadCpuClock};
use crate::backend::suspend::SuspendCell;
use crate::backend::tid::current_tid;
use crate::backend::voluntary_switches;
use crate::pi_mutex::PiMutex;
use alloc::boxed::Box;
use alloc::vec::Vec;
use core::sync::atomic::{AtomicBool, Ordering};
use sporadic::{BudgetServer, Kind, Level, Low, Params, Reservation};

/// The executor stops while a worker waits for budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stopped;

/// The account of one worker thread; owned and called by that thread alone.
///
/// ```text
///   loop { wait for work; activate(); for each callback { callback_begin()?; run; callback_end() } block() }
/// ```
///
/// A worker without a budget has an account, too ([`Account::unbudgeted`]): it only tells CPU time.
#[derive(Debug)]
pub struct Account {
    meter: Meter,
    switches_seen: u64,
}

/// Reads a worker's account from any thread, at any time; cheap to clone.
#[derive(Clone, Debug)]
pub struct Meter(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    tid: Tid,
    clock: ThreadCpuClock,
    /// CPU time of an unbudgeted thread at its last reading, for after its end.
    last_cpu: PiMutex<Nanos>,
    budget: Option<Budgeted>,
}

#[derive(Debug)]
struct Budgeted {
    shared: Arc<Shared>,
    index: usize,
    wake: Notify,
    suspend: Arc<SuspendCell>,
    cancelled: AtomicBool,
    has_switch_log: bool,
    suspends: bool,
}

/// What a worker has used so far; times in nanoseconds of CPU time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// CPU time at the high priority (all of it for a worker without a budget).
    pub cpu_high: Nanos,
    /// CPU time at the background priority.
    pub cpu_low: Nanos,
    /// What the budget has left at this moment (0 without a budget).
    pub available: Nanos,
    /// Whether the worker is at its background priority (or suspended, or deferred) now.
    pub low: bool,
    /// How often the budget ran out while the worker ran.
    pub exhaustions: u64,
    /// How often a replenishment raised the worker.
    pub replenishments: u64,
    /// Stretches of blocking inside callbacks that were seen and accounted.
    pub blocked_inside: u64,
}

impl Account {
    /// An account for the calling thread that has no budget to hold.
    #[must_use]
    pub fn unbudgeted() -> Self {
        Self::over(current_tid(), None)
    }

    #[inline(never)] // what it moves about would stay on the stack of the worker
    pub(super) fn enroll(
        shared: &Arc<Shared>,
        params: &Params,
        kind: Kind,
    ) -> Result<Self, EnrollError> {
        let config = &shared.config;
        if !shared.is_deferred() && params.priority() >= config.priority {
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
        // Without the records the voluntary-switch counter stands in: see callback_end().
        let detector = BlockingDetector::new(tid, config.switch_log);
        let has_switch_log = detector.is_exact();
        let suspends = params.low() == Low::Suspend && !shared.is_deferred();
        let suspend = Arc::new(SuspendCell::new());
        if suspends {
            suspend.attach_current_thread().map_err(EnrollError::Os)?;
        }
        let overruns = Box::default();
        let index = {
            let mut state = shared.state.lock();
            let (index, capacity) = (state.entries.len(), state.entries.capacity());
            if index == capacity {
                return Err(EnrollError::Full { capacity });
            }
            // Made where it is to stay: it is large.
            let server = AnyServer::clamped(kind, *params, now).with_min_chunk(config.tuning.slack);
            let reservation = Reservation::new(server, config.tuning, now, cpu);
            let cell = Arc::clone(&suspend);
            let entry = Entry::new(reservation, tid, detector, cell, overruns);
            state.entries.push(entry);
            index
        };
        let wake = Notify::new();
        let cancelled = AtomicBool::new(false);
        let shared = Arc::clone(shared);
        let budget = Budgeted {
            shared,
            index,
            wake,
            suspend,
            cancelled,
            has_switch_log,
            suspends,
        };
        Ok(Self::over(tid, Some(budget)))
    }

    fn over(tid: Tid, budget: Option<Budgeted>) -> Self {
        let clock = ThreadCpuClock::of(tid);
        let inner = Inner {
            tid,
            clock,
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
    /// Takes the last reading while the thread still has a clock; the entry stays for its readers.
    fn drop(&mut self) {
        let inner = &self.meter.0;
        *inner.last_cpu.lock() = inner.clock.read().unwrap_or(0);
        self.meter.abandon();
        if let Some(b) = &inner.budget {
            b.suspend.detach_current_thread();
        }
    }
}

impl Meter {
    /// The worker's thread.
    #[must_use]
    pub fn tid(&self) -> Tid {
        self.0.tid
    }

    /// Which rung holds the worker's budget; `None` without a budget.
    #[must_use]
    pub fn enforcement(&self) -> Option<Enforcement> {
        self.0.budget.as_ref().map(|b| b.shared.rung)
    }

    /// Whether blocking inside callbacks is seen exactly, through the kernel's records.
    #[must_use]
    pub fn sees_blocking(&self) -> bool {
        self.0.budget.as_ref().is_some_and(|b| b.has_switch_log)
    }

    /// What the worker has used up to this moment. Takes the enforcer's lock briefly (with
    /// priority inheritance) and does not allocate.
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

    /// How far the budget was overrun, newest exhaustions first. Allocates: not for the hot path.
    #[must_use]
    pub fn overruns(&self) -> OverrunSummary {
        let Some(b) = &self.0.budget else {
            return OverrunSummary::default();
        };
        let mut sample = Vec::with_capacity(1024);
        let totals = {
            let state = b.shared.state.lock();
            let Some(entry) = state.entries.get(b.index) else {
                return OverrunSummary::default();
            };
            entry.overruns.copy_into(&mut sample)
        };
        summarise(&mut sample, totals)
    }

    /// The samples behind [`overruns`](Self::overruns). Allocates: not for the hot path.
    #[must_use]
    pub fn overrun_samples(&self) -> OverrunSamples {
        let Some(b) = &self.0.budget else {
            return OverrunSamples::default();
        };
        let mut overruns = Vec::with_capacity(1024);
        let (stalls, kept) = {
            let state = b.shared.state.lock();
            let Some(entry) = state.entries.get(b.index) else {
                return OverrunSamples::default();
            };
            entry.overruns.copy_into(&mut overruns);
            entry.overruns.newest_stalls()
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
            b.suspend.resume();
            b.wake.set();
        }
    }

    /// Stops supervising a thread that does not come back from its callback. The caller decides
    /// what priority it keeps.
    pub fn abandon(&self) {
        if let Some(b) = &self.0.budget {
            b.with(|entry| {
                entry.observe(clock::monotonic());
                entry.release();
            });
        }
    }
}

impl Inner {
    /// CPU time so far. Its own clock is cheaper for a thread than that of any other.
    fn cpu(&self) -> Nanos {
        if current_tid() == self.tid {
            return clock::thread_cpu();
        }
        let reading = self.clock.read();
        reading.unwrap_or_else(|| *self.last_cpu.lock())
    }
}

impl Budgeted {
    /// [`Meter::usage`].
    fn usage(&self) -> Usage {
        let mut state = self.shared.state.lock();
        let Some(entry) = state.entries.get_mut(self.index) else {
            return Usage::default();
        };
        let now = clock::monotonic();
        if entry.live {
            entry.observe(now);
        }
        let r = &entry.reservation;
        let c = r.counters();
        Usage {
            cpu_high: c.cpu_high,
            cpu_low: c.cpu_low,
            available: r.server().available(now),
            low: r.level() == Level::Low,
            exhaustions: c.exhaustions,
            replenishments: c.replenishments,
            blocked_inside: c.blocked_inside,
        }
    }

    fn activate(&self, woken: Nanos) {
        self.with(|entry| entry.activate(woken, clock::monotonic()));
    }

    fn block(&self) {
        self.with(|entry| entry.block(clock::monotonic()));
    }

    /// [`Account::callback_begin`]; keeps in `switches` how often the thread has blocked.
    fn begin(&self, switches: &mut u64) -> Result<(), Stopped> {
        if self.suspends {
            self.suspend.wait_while_suspended();
        }
        if self.shared.is_deferred() {
            self.wait_for_budget()?;
        }
        if !backend::config::ALWAYS_EXACT && !self.has_switch_log {
            *switches = voluntary_switches();
        }
        match self.cancelled.load(Ordering::Acquire) {
            true => Err(Stopped),
            false => Ok(()),
        }
    }

    /// [`Account::callback_end`].
    fn end(&self, switches: u64) {
        if !backend::config::ALWAYS_EXACT
            && !self.has_switch_log
            && voluntary_switches() != switches
        {
            self.with(|entry| entry.blocked_inside(clock::monotonic()));
        }
    }

    /// One step on the entry under the lock, and the timer set if the step asks for it earlier.
    /// The step changes no priority: that is the enforcer's alone.
    fn with(&self, step: impl FnOnce(&mut Entry)) {
        let mut state = self.shared.state.lock();
        let Some(entry) = state.entries.get_mut(self.index) else {
            return;
        };
        step(entry);
        self.stepped(&mut state);
    }

    /// The timer after a step on the entry.
    #[cfg_attr(target_os = "none", inline(never))]
    fn stepped(&self, state: &mut State) {
        let Some(entry) = state.entries.get(self.index) else {
            return;
        };
        let mut at = entry.timer_at(self.shared.timer.as_ref());
        if !entry.reservation.is_runnable() {
            at = at.min(state.pull_in(clock::monotonic()));
        }
        self.shared.arm(state, at);
    }

    /// The rung without privilege: an exhausted worker waits here.
    fn wait_for_budget(&self) -> Result<(), Stopped> {
        loop {
            if self.cancelled.load(Ordering::Acquire) {
                return Err(Stopped);
            }
            let mut state = self.shared.state.lock();
            let Some(entry) = state.entries.get_mut(self.index) else {
                return Ok(());
            };
            entry.judge(clock::monotonic(), Enforcement::Deferred);
            if entry.reservation.level() == Level::High {
                return Ok(());
            }
            let due = entry.reservation.server().next_replenishment();
            drop(state);
            if let Some(at) = due {
                self.wake.wait_until(at);
            }
        }
    }
}
