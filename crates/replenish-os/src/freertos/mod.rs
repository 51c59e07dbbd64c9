//! The FreeRTOS back end: tasks with our policies over a kernel without tick and without heap.
//!
//! The image compiles the kernel with `freertos/FreeRTOSConfig.h` and `freertos/shim.c` of this
//! crate, has a global allocator ([`SealedHeap`] or its own), and gives this back end a timer:
//!
//! ```text
//!   image            rp_board_now() -> ns ────────► clock, switch hooks
//!                    rp_board_arm(ns) ◄──────────── earliest deadline of all tasks
//!                    its interrupt ──► on_timer() ─► wakes who waited for it
//!   kernel           traceTASK_SWITCHED_OUT/IN ───► CPU time, preempted or blocked
//! ```
//!
//! Every wait with an end is one of our deadlines in nanoseconds, so the kernel's tick is off and
//! an idle board sleeps (`WFI`) until the next deadline or interrupt.
//!
//! What each task takes: its stack, a TCB of the kernel and a slot of 208 bytes; see
//! [`Thread::stack_unused`](crate::Thread::stack_unused).

mod alarm;
#[path = "../rtos/atomic.rs"]
mod atomic;
#[path = "../rtos/blocked_intervals.rs"]
mod blocked_intervals;
#[path = "../rtos/blocking_detector.rs"]
pub(crate) mod blocking_detector;
#[path = "../rtos/clock.rs"]
pub mod clock;
#[cfg(all(feature = "compact", target_arch = "arm"))]
mod compact;
#[path = "../rtos/critical_section.rs"]
mod critical_section;
#[path = "../rtos/error.rs"]
mod error;
mod ffi;
#[path = "../rtos/futex.rs"]
pub(crate) mod futex;
pub(crate) mod granted;
mod heap;
#[path = "../rtos/inherit.rs"]
mod inherit;
mod launch;
#[path = "../rtos/memory.rs"]
pub mod memory;
#[path = "../rtos/name.rs"]
mod name;
#[path = "../rtos/panicked.rs"]
mod panicked;
mod panics;
#[path = "../rtos/pi_lock.rs"]
pub(crate) mod pi_lock;
#[path = "../rtos/poll.rs"]
pub(crate) mod poll;
#[path = "../rtos/privilege.rs"]
pub mod privilege;
pub(crate) mod sched;
#[path = "../rtos/spawn_error.rs"]
pub(crate) mod spawn_error;
mod start;
pub(crate) mod suspend;
pub(crate) mod task_slot;
mod tasks;
#[path = "../rtos/thread.rs"]
pub(crate) mod thread;
#[path = "../rtos/tid.rs"]
pub(crate) mod tid;
#[path = "../rtos/timer.rs"]
pub mod timer;

pub use atomic::AtomicU64;
pub use error::OsError;
pub use heap::{HeapUse, SealedHeap};
pub use panicked::{Panicked, panicked};
pub use panics::{fault, halt, on_stop};
pub use start::{on_timer, start};
pub use task_slot::voluntary_switches;
pub use tasks::{KernelUse, TaskUse, kernel, tasks};

/// Pending replenishments of a budget at most: 16 bytes each.
pub(crate) const MAX_REPL: usize = 10;
/// Budgeted workers of an enforcer unless said otherwise.
pub(crate) const ENFORCER_CAPACITY: usize = 8;
/// Stack of an enforcer in bytes.
pub(crate) const ENFORCER_STACK: usize = 3072;
/// Whether blocking inside callbacks is always seen exactly.
pub(crate) const ALWAYS_EXACT: bool = true;
/// How many of the newest overruns of a worker are kept.
pub(crate) const OVERRUNS_KEPT: usize = 8;

/// What this kernel has, for who asked for something else.
const POLICIES: &str = "FreeRTOS has FIFO, and sporadic by the enforcer";

/// Says what went wrong where nobody is there to be told.
/// (It never has arguments here: the kernel's timers cannot fail.)
pub(crate) fn complain(what: core::fmt::Arguments<'_>) {
    let what = what.as_str().unwrap_or("the enforcer failed");
    for part in [ffi::PREFIX, what.as_bytes(), b"\n"] {
        ffi::print(part);
    }
}
