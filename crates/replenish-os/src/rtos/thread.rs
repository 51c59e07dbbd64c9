//! Tasks from a small kernel: memory at set-up, a closure, a result to wait for.
//!
//! ```text
//!   spawn: slot ─ launch (the back end) at its priority ──► closure ─ result ─ done
//! ```

use super::launch;
use super::slot::{self, Slot};
use super::spawn_error::SpawnError;
use super::tid::Tid;
use crate::backend::pi_mutex::PiMutex;
use crate::{Nanos, Policy, Signal};
use alloc::boxed::Box;
use alloc::ffi::CString;
use alloc::string::String;
use alloc::sync::Arc;
use core::any::Any;
use core::sync::atomic::{AtomicBool, Ordering};

/// What a new task shall have; see the fields.
#[derive(Clone, PartialEq, Eq, Debug)]
#[must_use]
pub struct ThreadSpec {
    /// Shown by debuggers; the kernel keeps the first 15 bytes.
    pub name: String,
    /// The policy; `Other` is the lowest there is.
    pub policy: Policy,
    /// `None` or 0.
    pub cpu: Option<usize>,
    /// The stack in bytes; `None`: 2048 (`NuttX`: 4096). Rounded up to 8.
    pub stack_size: Option<usize>,
    /// Without meaning here.
    pub reset_on_fork: bool,
}

impl ThreadSpec {
    /// A task called `name` at priority 1.
    pub fn new(name: impl Into<String>) -> Self {
        let name = name.into();
        Self {
            name,
            policy: Policy::Other,
            cpu: None,
            stack_size: None,
            reset_on_fork: true,
        }
    }

    /// Sets the policy.
    pub fn policy(mut self, policy: Policy) -> Self {
        self.policy = policy;
        self
    }

    /// Says on which CPU; there is number 0.
    pub fn cpu(mut self, cpu: impl Into<Option<usize>>) -> Self {
        self.cpu = cpu.into();
        self
    }

    /// Sets the stack size in bytes.
    pub fn stack_size(mut self, bytes: usize) -> Self {
        self.stack_size = Some(bytes);
        self
    }

    /// Without meaning here.
    pub fn reset_on_fork(mut self, reset: bool) -> Self {
        self.reset_on_fork = reset;
        self
    }
}

#[derive(Debug)]
struct End<T> {
    finished: AtomicBool,
    done: Signal,
    result: PiMutex<Option<T>>,
}

/// A task. Dropping this lets it go on by itself.
#[derive(Debug)]
pub struct Thread<T> {
    pub(super) slot: &'static Slot,
    end: Arc<End<T>>,
}

impl<T> Thread<T> {
    /// Its number.
    #[must_use]
    pub fn tid(&self) -> Tid {
        Tid::of(self.slot)
    }

    /// Whether the task's function has returned.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.end.finished.load(Ordering::Acquire)
    }

    /// Waits for the task's function to return. A task that panicked never does.
    ///
    /// # Errors
    /// If another join took the result.
    pub fn join(self) -> Result<T, Box<dyn Any + Send>> {
        self.end.done.wait();
        self.take()
    }

    /// Waits for the task's function to return, at most until `deadline`.
    ///
    /// # Errors
    /// The task itself if it still runs then.
    pub fn join_until(self, deadline: Nanos) -> Result<Result<T, Box<dyn Any + Send>>, Self> {
        if self.end.done.wait_until(deadline) {
            Ok(self.take())
        } else {
            Err(self)
        }
    }

    fn take(self) -> Result<T, Box<dyn Any + Send>> {
        let result = self.end.result.lock().take();
        result.ok_or_else(|| -> Box<dyn Any + Send> { Box::new("the result was taken") })
    }
}

/// Starts a task that runs `f` with all of `spec`. It may run before this returns. Set-up only.
///
/// # Errors
/// [`SpawnError`] says what was asked and what would be granted.
pub fn spawn<T, F>(spec: ThreadSpec, f: F) -> Result<Thread<T>, SpawnError>
where
    F: FnOnce() -> T + Send + 'static,
    T: Send + 'static,
{
    let how = launch::how(spec.policy.validate()?)?;
    if let Some(cpu) = spec.cpu.filter(|&cpu| cpu != 0) {
        return Err(SpawnError::Cpu { cpu });
    }
    let name = CString::new(spec.name).map_err(|_| SpawnError::Name)?;
    let end = Arc::new(End {
        finished: AtomicBool::new(false),
        done: Signal::new(),
        result: PiMutex::new(None),
    });
    let theirs = Arc::clone(&end);
    let bytes = spec.stack_size.unwrap_or(launch::DEFAULT_STACK);
    let slot = launch::start(
        how,
        name,
        bytes,
        Box::new(move |slot| {
            let result = f();
            *theirs.result.lock() = Some(result);
            slot::end(slot);
            theirs.finished.store(true, Ordering::Release);
            theirs.done.set();
        }),
    )?;
    Ok(Thread { slot, end })
}
