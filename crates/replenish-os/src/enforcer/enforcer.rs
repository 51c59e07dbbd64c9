//! The enforcer itself: started, asked and stopped from any thread.

use super::account::Account;
use super::config::{Enforcement, EnforcerConfig, EnforcerStats, EnrollError, Fault};
use super::state::EnforcerState;
use super::supervision::{Supervision, Watched};
use crate::backend;
use crate::backend::clock::ThreadCpuClock;
use crate::backend::console::complain;
use crate::backend::lock_wait::lock_from_another_thread;
use crate::backend::memory::{self, LockError};
use crate::backend::spawn_error::SpawnError;
use crate::backend::thread::{Thread, spawn};
use crate::backend::timer::TimerFd;
use crate::pi_mutex::PiMutex;
use crate::{Arc, Policy, ThreadSpec};
use alloc::format;
use alloc::string::String;
use core::sync::atomic::Ordering;
use sporadic::{Kind, Params};

/// One enforcer and the threads enrolled with it. Cheap to share; see the module's text.
#[derive(Debug)]
pub struct Enforcer {
    state: Arc<EnforcerState>,
    thread: PiMutex<Option<Thread<()>>>,
    cpu_clock: Option<ThreadCpuClock>,
    supervision: Option<Supervision>,
    unlocked: Option<LockError>,
}

impl Enforcer {
    /// Starts the thread and sets up the memory for all workers.
    ///
    /// # Errors
    /// [`SpawnError`] when the CPU does not exist or the priority is not granted (then
    /// [`Enforcer::deferred`] is the declared fallback).
    pub fn start(config: EnforcerConfig) -> Result<Arc<Self>, SpawnError> {
        let mode = if config.cpu.is_some() {
            Enforcement::SameCpu
        } else {
            Enforcement::OtherCpu
        };
        let timer = TimerFd::new().map_err(SpawnError::Create)?;
        let name = match config.cpu {
            Some(cpu) if cfg!(target_os = "linux") => format!("enforcer/{cpu}"),
            _ => String::from("enforcer"), // one CPU, and no room for formatting
        };
        let mut spec = ThreadSpec::new(name)
            .policy(Policy::Fifo {
                priority: config.priority,
            }) // checked by `spawn`
            .stack_size(backend::config::ENFORCER_STACK);
        if let Some(cpu) = config.cpu {
            spec = spec.cpu(cpu);
        }
        let keep = config.keep_memory;
        let state = Arc::new(EnforcerState::new(config, mode, Some(timer)));
        let watched = Watched::of(&state);
        let theirs = Arc::clone(&watched);
        let thread = spawn(spec, move || theirs.run())?;
        let cpu_clock = Some(ThreadCpuClock::of(thread.tid()));
        let supervision = Some(Supervision::of(watched, thread.tid()));
        // After the start of the thread, so that its stack is locked as well.
        let unlocked = keep.then(memory::keep_program).and_then(Result::err);
        Ok(Arc::new(Self {
            state,
            thread: PiMutex::new(Some(thread)),
            cpu_clock,
            supervision,
            unlocked,
        }))
    }

    /// The mode without privilege: accounts, and defers callbacks that find no budget. No thread.
    /// Not without an operating system: privilege is never refused there.
    #[cfg(not(target_os = "none"))]
    #[must_use]
    pub fn deferred() -> Arc<Self> {
        let state = EnforcerState::new(EnforcerConfig::unpinned(), Enforcement::Deferred, None);
        Arc::new(Self {
            state: Arc::new(state),
            thread: PiMutex::new(None),
            cpu_clock: None,
            supervision: None,
            unlocked: None,
        })
    }

    /// Mode in which this enforcer holds budgets.
    #[must_use]
    pub fn enforcement(&self) -> Enforcement {
        self.state.mode
    }

    /// Supervises the *calling* thread from now on. It must already run at the budget's high
    /// priority (FIFO) and be pinned where this enforcer is. Set-up only: this allocates.
    ///
    /// # Errors
    /// [`EnrollError`] when there is no room, or the parameters do not fit.
    pub fn enroll(&self, params: &Params, kind: Kind) -> Result<Account, EnrollError> {
        Account::enroll(&self.state, params, kind)
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
            ..lock_from_another_thread(&self.state.threads).stats
        }
    }

    /// The reason why no watchdog looks after this enforcer; `None` where one does, or where an
    /// enforcer needs none: on small kernels, and without a thread of its own.
    #[must_use]
    pub fn watchdog_refused(&self) -> Option<&SpawnError> {
        self.supervision.as_ref()?.refused()
    }

    /// The reason why the program is not kept in memory, where [`EnforcerConfig::keep_memory`]
    /// asked for it.
    ///
    /// The enforcer may wait for a disk when memory runs short then, and budgets end late.
    #[must_use]
    pub const fn memory_refused(&self) -> Option<&LockError> {
        self.unlocked.as_ref()
    }

    /// Has `hook` called with everything that the watchdog finds, on a thread without real-time
    /// priority. Of what happens again and again, it hears whenever the count has doubled. Replaces
    /// an earlier hook.
    pub fn on_fault(&self, hook: impl Fn(&Fault) + Send + Sync + 'static) {
        if let Some(supervision) = &self.supervision {
            supervision.on_fault(hook);
        }
    }

    /// Ends the thread. Workers still enrolled stay at the level they have.
    pub fn stop(&self) {
        self.state.stop.store(true, Ordering::SeqCst);
        if let Some(supervision) = &self.supervision {
            supervision.end();
        }
        // The thread sees the flag and ends.
        if let Err(e) = self.state.fire_now() {
            complain(format_args!("enforcer: cannot arm its timer to stop: {e}"));
            return;
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
