//! The enforcer: the thread that lowers a worker whose budget is used up and raises it again when
//! a replenishment is due.
//!
//! Linux has no sporadic scheduling policy. Workers run under `SCHED_FIFO`; one enforcer per CPU,
//! above them and on the same CPU, drives a [`sporadic::Reservation`] per worker:
//!
//! ```text
//!   worker (FIFO P)                     enforcer (FIFO 99, same CPU)
//!   activate ── set timer if none ───►  timerfd
//!   run callback …                        │ fires at now + available
//!        ◄── preempted ─────────────── judge by the worker's CPU clock
//!   (FIFO L)  ◄── demote to the tail ──   │ exhausted
//!        ◄── promote ──────────────────── │ replenishment due
//!   block: charge, leave the timer alone
//! ```
//!
//! Because the enforcer preempts the worker it judges, the clock it reads is exact and the level
//! changes before the worker can run again. The timer is lazy (see [`sporadic::Reservation`]):
//! callbacks that stay within their budget cost one lock and one clock reading at each end.
//!
//! - `mod.rs`: the shared state, start and stop, the thread.
//! - [`enforced_thread`]: one supervised thread: its reservation and how a verdict is applied.
//! - [`account`]: the worker's side, and [`Meter`], the reader's.
//!
//! The same code runs on every back end. What differs comes from `crate::backend`: the timer, CPU
//! clocks, changes of priority, `BlockingDetector` (who blocked inside a callback?) and `SuspendCell` (the
//! low mode that stops a thread altogether).
//!
//! Why it is built like this, with figures: `docs/enforcement.md`.

mod account;
mod enforced_thread;
mod overruns;

pub use account::{Account, Meter, Stopped, Usage};
pub use overruns::{OverrunSamples, OverrunSummary, STALL, Stall};

use crate::Arc;
use crate::backend::clock::{self, ThreadCpuClock};
use crate::backend::console::complain;
use crate::backend::spawn_error::SpawnError;
use crate::backend::thread::{Thread, spawn};
use crate::backend::timer::TimerFd;
use crate::backend::{self, OsError};
use crate::pi_mutex::PiMutex;
use crate::{Nanos, Policy, ThreadSpec};
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use core::sync::atomic::{AtomicBool, Ordering};
use enforced_thread::Entry;
use sporadic::{Kind, Params, Server, Tuning};

/// The end of time, in the place of no time at all.
const NEVER: Nanos = Nanos::MAX;

/// How many pending replenishments a budget may have at most on this system.
pub const MAX_REPL: usize = backend::config::MAX_REPL;

/// The server type that is enforced here.
pub(crate) type AnyServer = Server<MAX_REPL>;

/// Which rung of the ladder holds budgets. Reported per worker, never changed silently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Enforcement {
    /// An enforcer thread on the worker's own CPU: overrun of a few microseconds.
    SameCpu,
    /// An enforcer that may run on another CPU, for workers that are not pinned: the overrun
    /// grows by an inter-processor interrupt (about 40 µs in a virtual machine, literature).
    OtherCpu,
    /// No privilege to change priorities: a callback that finds its budget used up waits for the
    /// next replenishment before it starts. A callback that runs is never interrupted; what it
    /// takes too much is a debt to later callbacks.
    Deferred,
}

impl fmt::Display for Enforcement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::SameCpu => "enforced on its CPU",
            Self::OtherCpu => "enforced from any CPU",
            Self::Deferred => "held at callback boundaries only",
        })
    }
}

/// What an enforcer is made with.
#[derive(Clone, Debug)]
pub struct EnforcerConfig {
    /// The CPU of the enforcer and of the workers it supervises; `None`: neither is pinned.
    pub cpu: Option<usize>,
    /// FIFO priority, 1..=99; must be above every worker's and the dispatcher's.
    pub priority: u8,
    /// How many workers can be enrolled, 1..=1024. All memory is set up with this number.
    pub capacity: usize,
    /// The constants of judgement.
    pub tuning: Tuning,
    /// Whether to record context switches, so that blocking inside callbacks is seen exactly.
    /// Where the kernel refuses, the voluntary-switch counter stands in (less exact, safe).
    pub switch_log: bool,
}

impl EnforcerConfig {
    /// The defaults for workers pinned to `cpu`: priority 99, room for 64 workers (8 on a
    /// microcontroller).
    #[must_use]
    pub fn on_cpu(cpu: usize) -> Self {
        Self {
            cpu: Some(cpu),
            ..Self::unpinned()
        }
    }

    /// The defaults for workers that are not pinned.
    #[must_use]
    pub fn unpinned() -> Self {
        Self {
            cpu: None,
            priority: 99,
            capacity: backend::config::ENFORCER_CAPACITY,
            tuning: Tuning::LINUX,
            switch_log: true,
        }
    }
}

/// Why a thread could not be enrolled.
#[derive(Debug)]
#[non_exhaustive]
pub enum EnrollError {
    /// Every place is taken: [`EnforcerConfig::capacity`].
    Full {
        /// The configured number of places.
        capacity: usize,
    },
    /// The worker's priority is not below the enforcer's.
    PriorityTooHigh {
        /// The worker's FIFO priority.
        worker: u8,
        /// The enforcer's FIFO priority.
        enforcer: u8,
    },
    /// The budget's parameters do not fit this system.
    Params(sporadic::ParamError),
    /// The kernel refused something at set-up.
    Os(OsError),
}

impl fmt::Display for EnrollError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Full { capacity } => {
                write!(
                    f,
                    "the enforcer has room for {capacity} budgeted workers and all are taken"
                )
            }
            Self::PriorityTooHigh { worker, enforcer } => write!(
                f,
                "priority {worker} of a budgeted worker must be below the enforcer's, {enforcer}"
            ),
            Self::Params(e) => e.fmt(f),
            Self::Os(e) => write!(f, "enrolling a worker: {e}"),
        }
    }
}

impl core::error::Error for EnrollError {}

/// Counters of one enforcer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EnforcerStats {
    /// How often the timer fired.
    pub wakes: u64,
    /// Wakes that found nothing to decide: the price of the lazy timer.
    pub idle_wakes: u64,
    /// Level changes carried out.
    pub changes: u64,
    /// Level changes the kernel refused (for instance because a privilege was taken away).
    pub refused: u64,
    /// CPU time of the enforcer thread in nanoseconds.
    pub cpu: Nanos,
}

/// One enforcer and the threads enrolled with it. Cheap to share; see the module's text.
#[derive(Debug)]
pub struct Enforcer {
    shared: Arc<Shared>,
    thread: PiMutex<Option<Thread<()>>>,
    cpu_clock: Option<ThreadCpuClock>,
}

#[derive(Debug)]
pub(crate) struct Shared {
    state: PiMutex<State>,
    timer: Option<TimerFd>,
    stop: AtomicBool,
    rung: Enforcement,
    config: EnforcerConfig,
}

#[derive(Debug)]
struct State {
    entries: Vec<Entry>,
    /// What the timer is set to; [`NEVER`]: it is not.
    armed: Nanos,
    stats: EnforcerStats,
}

impl Enforcer {
    /// Starts the thread and sets up the memory for all workers.
    ///
    /// # Errors
    /// [`SpawnError`] when the CPU does not exist or the priority is not granted (then
    /// [`Enforcer::deferred`] is the declared fallback).
    pub fn start(config: EnforcerConfig) -> Result<Arc<Self>, SpawnError> {
        let rung = if config.cpu.is_some() {
            Enforcement::SameCpu
        } else {
            Enforcement::OtherCpu
        };
        let timer = TimerFd::new().map_err(SpawnError::Create)?;
        let name = match config.cpu {
            Some(cpu) if cfg!(target_os = "linux") => format!("enforcer/{cpu}"),
            _ => String::from("enforcer"), // one CPU, and no room for formatting
        };
        let mut spec = ThreadSpec::new(&name)
            .policy(Policy::Fifo {
                priority: config.priority,
            }) // checked by `spawn`
            .stack_size(backend::config::ENFORCER_STACK);
        if let Some(cpu) = config.cpu {
            spec = spec.cpu(cpu);
        }
        let shared = Arc::new(Shared::new(config, rung, Some(timer)));
        let theirs = Arc::clone(&shared);
        let thread = spawn(spec, move || theirs.run())?;
        let cpu_clock = Some(ThreadCpuClock::of(thread.tid()));
        Ok(Arc::new(Self {
            shared,
            thread: PiMutex::new(Some(thread)),
            cpu_clock,
        }))
    }

    /// The rung without privilege: accounts, and defers callbacks that find no budget. No thread.
    /// Not without an operating system: nobody refuses privilege there.
    #[cfg(not(target_os = "none"))]
    #[must_use]
    pub fn deferred() -> Arc<Self> {
        let shared = Shared::new(EnforcerConfig::unpinned(), Enforcement::Deferred, None);
        Arc::new(Self {
            shared: Arc::new(shared),
            thread: PiMutex::new(None),
            cpu_clock: None,
        })
    }

    /// Which rung this enforcer stands on.
    #[must_use]
    pub fn enforcement(&self) -> Enforcement {
        self.shared.rung
    }

    /// Supervises the *calling* thread from now on. It must already run at the budget's high
    /// priority (FIFO) and be pinned where this enforcer is. Set-up only: this allocates.
    ///
    /// # Errors
    /// [`EnrollError`] when there is no room, or the parameters do not fit.
    pub fn enroll(&self, params: &Params, kind: Kind) -> Result<Account, EnrollError> {
        Account::enroll(&self.shared, params, kind)
    }

    /// Counters so far; may be called from any thread at any time.
    #[must_use]
    pub fn stats(&self) -> EnforcerStats {
        let cpu = self
            .cpu_clock
            .as_ref()
            .and_then(ThreadCpuClock::read)
            .unwrap_or(0);
        EnforcerStats {
            cpu,
            ..self.shared.state.lock().stats
        }
    }

    /// Ends the thread. Workers still enrolled stay at the level they have.
    pub fn stop(&self) {
        self.shared.stop.store(true, Ordering::SeqCst);
        if let Some(timer) = &self.shared.timer {
            // An arming in the past fires at once; the thread sees the flag and ends.
            if let Err(e) = timer.arm(1) {
                complain(format_args!("enforcer: cannot arm its timer to stop: {e}"));
                return;
            }
        }
        let thread = self.thread.lock().take();
        if let Some(thread) = thread
            && thread.join().is_err()
        {
            complain(format_args!("the enforcer thread panicked"));
        }
    }
}

impl Drop for Enforcer {
    fn drop(&mut self) {
        self.stop();
    }
}

impl Shared {
    fn new(config: EnforcerConfig, rung: Enforcement, timer: Option<TimerFd>) -> Self {
        let entries = Vec::with_capacity(config.capacity.clamp(1, 1024));
        let state = State {
            entries,
            armed: NEVER,
            stats: EnforcerStats::default(),
        };
        Self {
            state: PiMutex::new(state),
            timer,
            stop: AtomicBool::new(false),
            rung,
            config,
        }
    }

    fn is_deferred(&self) -> bool {
        cfg!(not(target_os = "none")) && self.rung == Enforcement::Deferred
    }

    /// The enforcer thread. Nothing in here allocates.
    fn run(&self) {
        let Some(timer) = &self.timer else { return };
        while !self.stop.load(Ordering::SeqCst) {
            if timer.read().is_err() {
                continue; // interrupted by a signal
            }
            let mut state = self.state.lock();
            state.armed = NEVER;
            state.stats.wakes += 1;
            if !self.sweep(&mut state) {
                state.stats.idle_wakes += 1;
            }
            self.rearm(&mut state);
        }
    }

    /// Judges every entry whose check is due; returns whether any level changed.
    ///
    /// On the workers' own CPU none of them runs before this is over. So one reading of the time
    /// serves all, and what the sweep itself took is added to every check at the end: a worker
    /// has lost it, and a check that ignored it would come early.
    fn sweep(&self, state: &mut State) -> bool {
        let now = clock::monotonic();
        let (mut changed, mut refused) = (0, 0);
        for entry in &mut state.entries {
            if entry.is_due(now, self.config.tuning.slack) {
                match entry.judge(now, self.rung) {
                    enforced_thread::Outcome::Unchanged => {}
                    enforced_thread::Outcome::Changed => changed += 1,
                    enforced_thread::Outcome::Refused => refused += 1,
                }
            }
        }
        state.stats.changes += changed;
        state.stats.refused += refused;
        if changed > 0 {
            state.pull_in(now);
        }
        if self.rung == Enforcement::SameCpu {
            let took = clock::monotonic().saturating_sub(now);
            state
                .entries
                .iter_mut()
                .for_each(|entry| entry.postpone(took));
        }
        changed > 0
    }

    /// Arms the timer for the earliest check.
    fn rearm(&self, state: &mut State) {
        let timer = self.timer.as_ref();
        let mut at = NEVER;
        for entry in &state.entries {
            at = at.min(entry.timer_at(timer));
        }
        if at != NEVER {
            let floor = clock::monotonic().saturating_add(self.config.tuning.min_rearm);
            self.arm(state, at.max(floor));
        }
    }

    /// Makes sure that the timer fires at `at` or earlier.
    fn arm(&self, state: &mut State, at: Nanos) {
        let Some(timer) = &self.timer else { return };
        if at < state.armed && timer.arm(at).is_ok() {
            state.armed = at;
        }
    }
}

impl State {
    /// A worker left the CPU: those that waited for it are judged at their exact times again.
    /// Returns the earliest time that moved, [`NEVER`] if none did.
    fn pull_in(&mut self, now: Nanos) -> Nanos {
        let mut at = NEVER;
        for entry in &mut self.entries {
            at = at.min(entry.pull_in(now));
        }
        at
    }
}
