//! The `NuttX` back end: our policies and budgets over its pthreads.
//!
//! The image compiles `nuttx/shim.c` of this crate, which owns every type of the system and calls
//! its functions; the Rust side knows plain numbers only. [`check`] compares both sides, and the
//! configuration of the image, before the first thread is made.
//!
//! ```text
//!   system           clock_gettime ───────────────► clock, hooks
//!                    sem_clockwait ◄─────────────── a thread that waits, with its own deadline
//!                    note driver: suspend/resume ─► CPU time, preempted or blocked (hooks)
//!                    pthread_setschedprio ◄──────── policies, budgets, inheritance
//! ```
//!
//! Priority inheritance is ours: the system's own forgets a boost when the priority of the
//! boosted thread is set, which is what an enforcer does.
//!
//! ```text
//!   for the image    report (check) ─ heap ─ panics ─ console
//!   policies         launch ─ sched ─ suspend ─ granted                   (over rtos/)
//!   beneath          hooks ─ kernel ─ alarm ─► task_slot ─► report ─► ffi ─► shim.c
//!                    config: sizes
//! ```
//!
//! Under `--cfg nuttx_host` the same code and the same shim run on Linux, for tests.

pub(crate) mod alarm;
pub(crate) mod config;
pub(crate) mod console;
mod ffi;
pub(crate) mod granted;
mod heap;
mod hooks;
mod kernel;
pub(crate) mod launch;
mod panics;
mod report;
pub(crate) mod sched;
pub(crate) mod suspend;
pub(crate) mod task_slot;

/// The functions that `rtos/` takes from this back end.
pub(crate) mod port {
    pub(crate) use super::config::POLICIES;
    pub(crate) use super::ffi::{board_now, mask, unmask};
    pub(crate) use super::kernel::{block, place, wake};
    pub(crate) use super::task_slot::Task;
    pub(crate) use super::{alarm, launch, task_slot};
}

pub use crate::rtos::atomic::AtomicU64;
pub use crate::rtos::error::OsError;
pub use crate::rtos::panicked::{Panicked, panicked};
pub(crate) use crate::rtos::{
    blocking_detector, futex, lock_wait, pi_lock, poll, spawn_error, thread, tid,
};
pub use crate::rtos::{clock, memory, privilege, timer};
pub use heap::SystemHeap;
pub use panics::halt;
pub use report::{CheckError, SystemInfo, check};
pub use task_slot::voluntary_switches;
