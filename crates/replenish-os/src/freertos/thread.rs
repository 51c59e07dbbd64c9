//! Tasks: stack and control block from the image's heap at set-up, kept for good.
//!
//! ```text
//!   spawn: memory ─ slot ─ xTaskCreateStatic at its priority ──► closure ─ result ─ done ─ halted
//! ```
#![expect(
    unsafe_code,
    reason = "the closure goes through the kernel as a pointer"
)]

use super::error::OsError;
use super::ffi::{self, Creation, Task};
use super::slot::{self, Slot};
use super::spawn_error::SpawnError;
use super::tid::Tid;
use crate::backend::pi_mutex::PiMutex;
use crate::{Nanos, Policy, Signal};
use alloc::boxed::Box;
use alloc::ffi::CString;
use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec;
use core::any::Any;
use core::ffi::c_void;

/// The stack in bytes unless said otherwise.
pub(crate) const DEFAULT_STACK: usize = 2048;

/// What a new task shall have; see the fields.
#[derive(Clone, PartialEq, Eq, Debug)]
#[must_use]
pub struct ThreadSpec {
    /// Shown by debuggers; the kernel keeps the first 15 bytes.
    pub name: String,
    /// The policy. `Other` is FIFO at priority 1.
    pub policy: Policy,
    /// `None` or 0.
    pub cpu: Option<usize>,
    /// The stack in bytes; `None`: 2048. Rounded up to 8.
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
    done: Signal,
    result: PiMutex<Option<T>>,
}

/// A task. Dropping this lets it go on by itself.
#[derive(Debug)]
pub struct Thread<T> {
    slot: &'static Slot,
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
        self.slot.state.with(|s| s.ended)
    }

    /// Bytes of its stack that were never used so far.
    #[must_use]
    pub fn stack_unused(&self) -> usize {
        self.slot
            .state
            .with(|s| s.task)
            .map_or(0, ffi::stack_unused)
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
    spec.policy.validate()?;
    let priority = match spec.policy {
        Policy::Other => 1,
        Policy::Fifo { priority } => priority,
        Policy::Sporadic(params) => params.priority(),
        Policy::RoundRobin { .. } | Policy::Deadline { .. } => {
            return Err(SpawnError::Unsupported(spec.policy));
        }
    };
    if let Some(cpu) = spec.cpu.filter(|&cpu| cpu != 0) {
        return Err(SpawnError::Cpu { cpu });
    }
    let name = CString::new(spec.name).map_err(|_| SpawnError::Name)?;
    let end = Arc::new(End {
        done: Signal::new(),
        result: PiMutex::new(None),
    });
    let theirs = Arc::clone(&end);
    let bytes = spec.stack_size.unwrap_or(DEFAULT_STACK);
    let slot = slot::make(priority, bytes);
    let body: Box<dyn FnOnce() + Send> = Box::new(move || {
        let result = f();
        *theirs.result.lock() = Some(result);
        slot.state.with(|s| s.ended = true);
        theirs.done.set();
    });
    start(slot, name, bytes, priority, body)?;
    Ok(Thread { slot, end })
}

/// Hands memory and closure to the kernel.
pub(super) fn start(
    slot: &'static Slot,
    name: CString,
    stack_bytes: usize,
    priority: u8,
    body: Box<dyn FnOnce() + Send>,
) -> Result<Task, SpawnError> {
    let stack = vec![0_u64; stack_bytes.div_ceil(8)].leak();
    let tcb = vec![0_u64; ffi::tcb_bytes().div_ceil(8)].leak();
    let argument = Box::into_raw(Box::new((slot, body))).cast();
    let mut creation = Creation {
        entry,
        name: alloc::boxed::Box::leak(name.into_boxed_c_str()),
        stack,
        argument,
        priority,
        tcb,
        slot: core::ptr::from_ref(slot).cast(),
    };
    let task = ffi::create(&mut creation)
        .ok_or(SpawnError::Create(OsError("the kernel refused the task")))?;
    slot.state.with(|s| s.task = Some(task));
    Ok(task)
}

/// Every task's first function; the kernel's tasks never return.
unsafe extern "C" fn entry(argument: *mut c_void) {
    let argument = argument.cast::<(&'static Slot, Box<dyn FnOnce() + Send>)>();
    // SAFETY: the box that `start` gave away, taken back once.
    let (slot, body) = *unsafe { Box::from_raw(argument) };
    // A task of higher priority runs before its creator has noted the handle.
    slot.state
        .with(|s| s.task = s.task.or_else(ffi::current_task));
    body();
    ffi::halt()
}
