//! The operating-system edge of replenish: the only crate of the workspace with `unsafe`.
//!
//! - [`clock`]: monotonic time, CPU clocks of this and other threads, absolute sleep.
//! - [`Tid`], [`current_tid`], [`set_affinity`], [`affinity`]: naming and placing threads.
//! - [`SchedClass`], [`set_priority`], [`promote`], [`demote_to_tail`]: what an enforcer does to
//!   the threads it watches.
//! - [`PiMutex`]: a lock with priority inheritance.
//! - [`timer`]: one-shot timers on absolute monotonic time.
//!
//! Time is `u64` nanoseconds of `CLOCK_MONOTONIC` ([`Nanos`]) unless said otherwise.
//! Every `unsafe` block lives in a module of its own topic under `linux/` and wraps one system call.

#[cfg(target_os = "linux")]
mod linux;

#[cfg(target_os = "linux")]
pub use linux::{
    affinity::{CpuSet, affinity, set_affinity},
    clock,
    pi_mutex::{PiMutex, PiMutexGuard},
    sched::{SchedClass, demote_to_tail, promote, set_priority},
    tid::{Tid, current_tid},
    timer,
};

/// Nanoseconds: a point on `CLOCK_MONOTONIC` or a length of time, as the name around it says.
pub type Nanos = u64;
