//! How a task comes to life: stack and control block from the image's heap at set-up, kept for good.
#![expect(
    unsafe_code,
    reason = "the closure goes through the kernel as a pointer"
)]

use super::error::OsError;
use super::ffi::{self, Creation};
use super::name::Name;
use super::spawn_error::SpawnError;
use super::task_slot::{self, Slot};
use super::thread::Thread;
use crate::Policy;
use alloc::boxed::Box;
use alloc::vec;
use core::ffi::c_void;

/// The stack in bytes unless said otherwise.
pub(super) const DEFAULT_STACK: usize = 2048;

/// What a task does first, with its slot.
pub(super) type Body = Box<dyn FnOnce(&'static Slot) + Send>;

/// The priority a policy starts with.
pub(super) fn how(policy: &Policy) -> Result<u8, SpawnError> {
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
pub(super) fn start(
    priority: u8,
    name: &Name,
    stack_bytes: usize,
    body: Body,
) -> Result<&'static Slot, SpawnError> {
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
    let argument = argument.cast::<(&'static Slot, Body)>();
    // SAFETY: the box that `start` gave away, taken back once.
    let (slot, body) = *unsafe { Box::from_raw(argument) };
    // A task of higher priority runs before its creator has noted the handle.
    slot.state
        .with(|s| s.task = s.task.or_else(ffi::current_task));
    body(slot);
    ffi::halt()
}

impl<T> Thread<T> {
    /// Bytes of its stack that were never used so far.
    #[must_use]
    pub fn stack_unused(&self) -> usize {
        self.slot
            .state
            .with(|s| s.task)
            .map_or(0, ffi::stack_unused)
    }
}
