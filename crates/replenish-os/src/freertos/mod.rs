//! The FreeRTOS back end: tasks with our policies over a kernel without tick and without heap.
//!
//! The image compiles the kernel with `freertos/FreeRTOSConfig.h` and `freertos/shim.c` of this
//! crate, has a global allocator ([`SealedHeap`] or its own), and gives this back end a timer:
//!
//! ```text
//!   image            rp_board_now() -> ns ────────► clock, hooks
//!                    rp_board_arm(ns) ◄──────────── earliest deadline of all tasks (alarm)
//!                    its interrupt ──► on_timer() ─► wakes the tasks whose deadline has come
//!   kernel           traceTASK_SWITCHED_OUT/IN ───► CPU time, preempted or blocked (hooks)
//! ```
//!
//! Every wait with an end is one of our deadlines in nanoseconds, so the kernel's tick is off and
//! an idle board sleeps (`WFI`) until the next deadline or interrupt.
//!
//! ```text
//!   for the image    start ─ tasks ─ heap ─ panics ─ console ─ compact
//!   policies         launch ─ sched ─ suspend ─ granted                  (over rtos/)
//!   at a switch      hooks ─► alarm ─► task_slot ─► ffi ─► shim.c        config: sizes
//! ```
//!
//! Each task takes its stack, a TCB of the kernel and a slot of 208 bytes; see
//! [`Thread::stack_unused`](crate::Thread::stack_unused).

pub(crate) mod alarm;
#[cfg(all(feature = "compact", target_arch = "arm"))]
mod compact;
pub(crate) mod config;
pub(crate) mod console;
mod ffi;
pub(crate) mod granted;
mod heap;
mod hooks;
pub(crate) mod launch;
mod panics;
pub(crate) mod sched;
mod start;
pub(crate) mod suspend;
pub(crate) mod task_slot;
mod tasks;

/// The functions that `rtos/` takes from this back end.
pub(crate) mod port {
    pub(crate) use super::config::POLICIES;
    pub(crate) use super::ffi::{Task, block, board_now, mask, place, unmask, wake};
    pub(crate) use super::{alarm, launch, task_slot};
}

pub use crate::rtos::atomic::AtomicU64;
pub use crate::rtos::error::OsError;
pub use crate::rtos::panicked::{Panicked, panicked};
pub(crate) use crate::rtos::{
    blocking_detector, futex, lock_wait, pi_lock, poll, spawn_error, thread, tid,
};
pub use crate::rtos::{clock, memory, privilege, timer};
pub use heap::{HeapUse, SealedHeap};
pub use panics::{fault, halt, on_stop};
pub use start::{on_timer, start};
pub use task_slot::voluntary_switches;
pub use tasks::{KernelUse, TaskUse, kernel, tasks};
