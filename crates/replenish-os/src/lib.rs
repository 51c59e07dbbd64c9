//! The operating-system edge of replenish: the only crate of the workspace with `unsafe`.
//!
//! - [`Policy`], [`ThreadSpec`], [`spawn`], [`granted`]: threads that have what was asked before
//!   they run user code, and what the kernel says they have.
//! - [`Signal`]: the hand-off cell that one thread waits on.
//! - [`Enforcer`], [`Account`], [`Meter`]: budgets held by lowering and raising priorities.
//! - [`SwitchLog`], [`voluntary_switches`]: was a thread preempted, or did it block?
//! - [`PiMutex`]: a lock with priority inheritance.
//! - [`clock`], [`timer`]: monotonic time, CPU clocks of this and other threads, absolute sleep,
//!   one-shot timers.
//! - [`poll`], [`WakeFd`]: waiting on descriptors, and waking such a wait.
//! - [`connect_tcp`]: TCP without waiting for the other side.
//! - [`tty`]: serial lines and pseudo-terminals.
//! - [`memory`]: locking memory and touching stacks, so that page faults stay out.
//! - [`Tid`], [`current_tid`], [`set_affinity`], [`affinity`]: naming and placing threads.
//! - [`SchedClass`], [`set_priority`], [`promote`], [`demote_to_tail`]: what an enforcer does to
//!   the threads it watches.
//! - [`baseline`]: what the hand-off and the enforcer are measured against.
//! - [`privilege`], [`machine`]: what this process may do, the commands that grant what is missing,
//!   and what kind of machine this is.
//!
//! Time is `u64` nanoseconds of `CLOCK_MONOTONIC` ([`Nanos`]) unless said otherwise.
//! Every `unsafe` block lives in a module of its own topic under the back end's directory.
//!
//! # Back ends
//! | | Linux | `freertos` |
//! |---|---|---|
//! | chosen by | target | feature, on targets without an operating system |
//! | policies, `spawn`, `Thread`, `granted`, `set_priority`, `promote`, `demote_to_tail` | all | FIFO and sporadic |
//! | `Signal`, `PiMutex`, `clock`, `timer`, `Enforcer`, `Account`, `Meter`, `voluntary_switches` | yes | yes |
//! | `memory`, `privilege::may_be_real_time` | yes | yes, nothing to do |
//! | `poll`, `PollFd` | descriptors | no: `WakeFd::wait_until` waits for a wake-up alone |
//! | `SwitchLog`, `baseline`, `machine`, affinity, `tty`, `connect_tcp` | yes | no |
//! | `freertos`: start, interrupts, sealed heap, panics | no | yes |

#![cfg_attr(not(target_os = "linux"), no_std)]

extern crate alloc;

#[cfg(all(not(target_os = "linux"), feature = "freertos"))]
pub mod freertos;
#[cfg(target_os = "linux")]
mod linux;
mod policy;

#[cfg(all(not(target_os = "linux"), feature = "freertos"))]
pub(crate) use freertos as backend;
#[cfg(target_os = "linux")]
pub(crate) use linux as backend;

#[cfg(any(target_os = "linux", feature = "freertos"))]
mod enforcer;
#[cfg(any(target_os = "linux", feature = "freertos"))]
mod signal;
#[cfg(any(target_os = "linux", feature = "freertos"))]
mod sync_shim;

#[cfg(target_os = "linux")]
pub use backend::{
    affinity::{CpuSet, affinity, set_affinity},
    machine::{Machine, Preemption, machine},
    poll::{PollFd, poll},
    switches::{Drained, Switch, SwitchKind, SwitchLog},
    tcp::connect_tcp,
    tty,
};
#[cfg(any(target_os = "linux", feature = "freertos"))]
pub use backend::{
    clock,
    granted::{Granted, GrantedPolicy, granted},
    memory,
    pi_mutex::{PiMutex, PiMutexGuard},
    poll::WakeFd,
    privilege,
    sched::{SchedClass, demote_to_tail, promote, set_priority},
    spawn_error::SpawnError,
    thread::{Thread, ThreadSpec, spawn},
    tid::{Tid, current_tid},
    timer, voluntary_switches,
};
#[cfg(any(target_os = "linux", feature = "freertos"))]
pub use enforcer::{
    Account, Enforcement, Enforcer, EnforcerConfig, EnforcerStats, EnrollError, MAX_REPL, Meter,
    OverrunSamples, OverrunSummary, STALL, Stall, Stopped, Usage,
};
/// What others build on: here to be measured against, not to be used.
#[cfg(target_os = "linux")]
pub mod baseline {
    pub use crate::linux::bare_futex::BareFutex;
    pub use crate::linux::cpu_timer::CpuTimer;
}
pub use policy::{MAX_PRIORITY, MIN_RUNTIME, Policy, PolicyError};
#[cfg(any(target_os = "linux", feature = "freertos"))]
pub use signal::Signal;
pub use sporadic::{Level, Low, Nanos, ParamError, Params};
