//! Tasks from a small kernel: memory at set-up, a closure, a result to wait for.
//!
//! ```text
//!   spawn: slot ─ launch (the back end) at its priority ──► closure ─ result ─ done
//! ```
use super::name::Name;
use super::spawn_error::SpawnError;
use super::tid;
use crate::Arc;
use crate::PiMutex;
use crate::Tid;
use crate::backend::port::launch;
use crate::backend::port::task_slot::{self, TaskSlot};
use crate::backend::sched::{SchedClass, set_priority};
use crate::{Nanos, Notify, ThreadSpec};
use alloc::boxed::Box;
use core::any::Any;
use core::sync::atomic::{AtomicBool, Ordering};

#[derive(Debug)]
struct End<T> {
    finished: AtomicBool,
    done: Notify,
    result: PiMutex<Option<T>>,
}

impl<T> End<T> {
    /// The state of a task that has not ended. (One body for all tasks.)
    #[inline(never)]
    fn shared() -> Arc<Self> {
        Arc::new(Self {
            finished: AtomicBool::new(false),
            done: Notify::new(),
            result: PiMutex::new(None),
        })
    }
}

/// A task. Dropping this lets it go on by itself.
#[derive(Debug)]
pub struct Thread<T> {
    pub(crate) slot: &'static TaskSlot,
    end: Arc<End<T>>,
}

impl<T> Thread<T> {
    /// Its number.
    #[must_use]
    pub fn tid(&self) -> Tid {
        tid::of(self.slot)
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

    /// Gives the task the lowest priority.
    pub fn lower(&self) {
        set_priority(self.tid(), SchedClass::Other).ok();
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
#[expect(
    clippy::needless_pass_by_value,
    reason = "Linux takes it over: one signature for all"
)]
pub fn spawn<T, F>(spec: ThreadSpec, f: F) -> Result<Thread<T>, SpawnError>
where
    F: FnOnce() -> T + Send + 'static,
    T: Send + 'static,
{
    let end = End::shared();
    let theirs = Arc::clone(&end);
    let slot = boxed(
        &spec,
        Box::new(move |slot| {
            let result = f();
            *theirs.result.lock() = Some(result);
            task_slot::end(slot);
            theirs.finished.store(true, Ordering::Release);
            theirs.done.set();
        }),
    )?;
    Ok(Thread { slot, end })
}

/// The part of [`spawn`] that is the same for all of them.
fn boxed(spec: &ThreadSpec, body: launch::TaskBody) -> Result<&'static TaskSlot, SpawnError> {
    spec.policy.check()?;
    let how = launch::how(&spec.policy)?;
    if let Some(cpu) = spec.cpu.filter(|&cpu| cpu != 0) {
        return Err(SpawnError::Cpu { cpu });
    }
    let name = Name::new(&spec.name).ok_or(SpawnError::Name)?;
    let bytes = spec.stack_size.unwrap_or(launch::DEFAULT_STACK);
    launch::start(how, &name, bytes, body)
}
