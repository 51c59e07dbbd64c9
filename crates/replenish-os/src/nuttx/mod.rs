//! The `NuttX` back end: our policies and budgets over its pthreads.
//!
//! The image compiles `nuttx/shim.c` of this crate, which owns every type of the system and calls
//! its functions; the Rust side knows plain numbers only. What both must agree on, and what the
//! configuration of the image must have, is checked before the first thread is made ([`check`]).
//!
//! ```text
//!   system           clock_gettime ───────────────► clock, switch hooks
//!                    sem_clockwait ◄─────────────── a thread that waits, with its own deadline
//!                    note driver: suspend/resume ─► CPU time, preempted or blocked
//!                    pthread_setschedprio ◄──────── policies, budgets, inheritance
//! ```
//!
//! Priority inheritance is ours: the system's own forgets a boost when the priority of the
//! boosted thread is set, which is what an enforcer does.
//!
//! Under `--cfg nuttx_host` the same code and the same shim run on Linux, for tests.

pub(crate) mod alarm;
#[path = "../rtos/atomic.rs"]
mod atomic;
#[path = "../rtos/blocked_intervals.rs"]
mod blocked_intervals;
#[path = "../rtos/blocking_detector.rs"]
pub(crate) mod blocking_detector;
#[path = "../rtos/clock.rs"]
pub mod clock;
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
mod report;
pub(crate) mod sched;
#[path = "../rtos/spawn_error.rs"]
pub(crate) mod spawn_error;
pub(crate) mod suspend;
pub(crate) mod task_slot;
#[path = "../rtos/thread.rs"]
pub(crate) mod thread;
#[path = "../rtos/tid.rs"]
pub(crate) mod tid;
#[path = "../rtos/timer.rs"]
pub mod timer;

pub use atomic::AtomicU64;
pub use error::OsError;
pub use heap::SystemHeap;
pub use panicked::{Panicked, panicked};
pub use panics::halt;
pub use report::{CheckError, Facts, check};
pub use task_slot::voluntary_switches;

/// Pending replenishments of a budget at most: 16 bytes each.
pub(crate) const MAX_REPL: usize = if cfg!(nuttx_host) { 128 } else { 16 };
/// Budgeted workers of an enforcer unless said otherwise.
pub(crate) const ENFORCER_CAPACITY: usize = 8;
/// Stack of an enforcer in bytes.
pub(crate) const ENFORCER_STACK: usize = 4096;
/// Whether blocking inside callbacks is always seen exactly.
pub(crate) const ALWAYS_EXACT: bool = false;
/// How many of the newest overruns of a worker are kept.
pub(crate) const OVERRUNS_KEPT: usize = if cfg!(nuttx_host) { 1024 } else { 16 };

/// What this kernel has, for who asked for something else.
const POLICIES: &str = "NuttX has FIFO, round-robin (CONFIG_RR_INTERVAL), SCHED_SPORADIC \
                        (CONFIG_SCHED_SPORADIC), and sporadic by the enforcer";

/// Says what went wrong where nobody is there to be told.
pub(crate) fn complain(what: core::fmt::Arguments<'_>) {
    ffi::complain(what);
}
