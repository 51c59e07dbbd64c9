//! Starts a thread: `pthread_create` with the requested settings, detached.
#![expect(
    unsafe_code,
    reason = "the closure goes through the system as a pointer"
)]

use super::console::complain;
use super::ffi::{self, ShimPolicy};
use super::report::{self, SystemInfo};
use super::task_slot::{self, Task, TaskSlot};
use crate::rtos::error::OsError;
use crate::rtos::name::Name;
use crate::rtos::spawn_error::SpawnError;
use crate::{Low, Params, Policy};
use alloc::boxed::Box;
use core::ffi::c_void;
use core::ptr;

/// The stack in bytes unless said otherwise.
pub(crate) const DEFAULT_STACK: usize = if cfg!(nuttx_host) { 256 << 10 } else { 4096 };

/// The body of a thread; it gets the thread's slot.
pub(crate) type TaskBody = Box<dyn FnOnce(&'static TaskSlot) + Send>;

/// A policy in the shim's words.
pub(crate) fn how(policy: &Policy) -> Result<ShimPolicy, SpawnError> {
    let info = report::check()
        .map_err(|_| SpawnError::Create(OsError::new("nuttx::check() says what does not fit")))?;
    let at = |kind, priority: u8| ShimPolicy {
        kind,
        priority: priority.into(),
        ..ShimPolicy::default()
    };
    match *policy {
        Policy::Other => Ok(at(0, info.lowest)),
        Policy::Fifo { priority } => Ok(at(1, priority)),
        Policy::RoundRobin { priority } if info.round_robin => Ok(at(2, priority)),
        Policy::Sporadic(params) => Ok(at(1, params.priority())),
        Policy::KernelSporadic(params) if info.native_repl > 0 => Ok(native(&params, &info)),
        Policy::RoundRobin { .. } | Policy::KernelSporadic(_) | Policy::Deadline { .. } => {
            Err(SpawnError::Unsupported(*policy))
        }
    }
}

/// The system's own; it takes no more replenishments than it was configured with.
fn native(params: &Params, info: &SystemInfo) -> ShimPolicy {
    let low = match params.low() {
        Low::Background(low) => low.max(info.lowest),
        Low::Suspend => info.lowest,
    };
    let most = i32::try_from(info.native_repl).unwrap_or(i32::MAX);
    ShimPolicy {
        kind: 3,
        priority: params.priority().into(),
        low: low.into(),
        max_repl: i32::from(params.max_repl()).min(most),
        budget: params.budget(),
        period: params.period(),
    }
}

struct Start(&'static TaskSlot, Name, TaskBody);

/// Hands the closure to the system.
pub(crate) fn start(
    how: ShimPolicy,
    name: &Name,
    stack_bytes: usize,
    body: TaskBody,
) -> Result<&'static TaskSlot, SpawnError> {
    let priority = u8::try_from(how.priority).unwrap_or(u8::MAX);
    let slot = task_slot::make(priority, stack_bytes)
        .ok_or(SpawnError::Create(OsError::new("no slot for a thread")))?;
    let generation = slot.state.with(|s| s.generation);
    let argument = Box::into_raw(Box::new(Start(slot, *name, body)));
    match ffi::create(entry, argument.cast(), stack_bytes, &how) {
        Ok(id) => {
            // The thread may have run, and even ended, by now.
            slot.state.with(|s| {
                if s.generation == generation && s.task.is_none() && !s.ended {
                    slot.thread.note(id, priority);
                    s.task = Some(Task(slot));
                }
            });
            Ok(slot)
        }
        Err(refused) => {
            // SAFETY: no thread was made, so nothing else takes it back.
            drop(unsafe { Box::from_raw(argument) });
            task_slot::discard(slot);
            Err(SpawnError::Create(refused))
        }
    }
}

/// Every thread's first function.
unsafe extern "C" fn entry(argument: *mut c_void) -> *mut c_void {
    // SAFETY: the box that `start` gave away, taken back once.
    let Start(slot, name, body) = *unsafe { Box::from_raw(argument.cast::<Start>()) };
    if task_slot::begin(slot) {
        ffi::set_name(&name);
        body(slot);
    } else {
        complain(format_args!("a new thread was not given its slot"));
    }
    task_slot::release(slot);
    ptr::null_mut()
}
