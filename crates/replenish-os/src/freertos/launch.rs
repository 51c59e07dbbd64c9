//! Starting a task: stack and control block come from the image's heap, and stay for good.
#![expect(
    unsafe_code,
    reason = "the closure goes through the kernel as a pointer"
)]

use super::ffi::{self, Creation};
use super::task_slot::{self, TaskSlot};
use crate::Policy;
use crate::rtos::error::OsError;
use crate::rtos::name::Name;
use crate::rtos::spawn_error::SpawnError;
use alloc::boxed::Box;
use alloc::vec;
use core::ffi::c_void;

/// The stack in bytes unless said otherwise.
pub(crate) const DEFAULT_STACK: usize = 2048;

/// The body of a task; it gets the task's slot.
pub(crate) type TaskBody = Box<dyn FnOnce(&'static TaskSlot) + Send>;

/// The priority a policy starts with.
pub(crate) fn how(policy: &Policy) -> Result<u8, SpawnError> {
    match policy {
        Policy::Other => Ok(1),
        Policy::Fifo { priority } => Ok(*priority),
        Policy::Sporadic(params) => Ok(params.priority()),
        Policy::RoundRobin { .. } | Policy::KernelSporadic(_) | Policy::Deadline { .. } => {
            Err(SpawnError::Unsupported(*policy))
        }
    }
}

/// Hands memory and closure to the kernel.
pub(crate) fn start(
    priority: u8,
    name: &Name,
    stack_bytes: usize,
    body: TaskBody,
) -> Result<&'static TaskSlot, SpawnError> {
    let slot = task_slot::make(priority, stack_bytes);
    let stack = vec![0_u64; stack_bytes.div_ceil(8)].leak();
    let tcb = vec![0_u64; ffi::tcb_bytes().div_ceil(8)].leak();
    let argument = Box::into_raw(Box::new((slot, body))).cast();
    let mut creation = Creation {
        entry,
        name,
        stack,
        argument,
        priority,
        tcb,
        slot: core::ptr::from_ref(slot).cast(),
        id: slot.id,
    };
    let task = ffi::create(&mut creation).ok_or(SpawnError::Create(OsError::new(
        "the kernel refused the task",
    )))?;
    slot.state.with(|s| s.task = Some(task));
    Ok(slot)
}

/// Every task's first function; the kernel's tasks never return.
unsafe extern "C" fn entry(argument: *mut c_void) {
    let argument = argument.cast::<(&'static TaskSlot, TaskBody)>();
    // SAFETY: the box that `start` gave away, taken back once.
    let (slot, body) = *unsafe { Box::from_raw(argument) };
    // A task of higher priority runs before its creator has noted the handle.
    slot.state
        .with(|s| s.task = s.task.or_else(ffi::current_task));
    body(slot);
    ffi::halt()
}
