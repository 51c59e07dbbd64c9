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
//! Every `unsafe` block lives in a module of its own topic under `linux/` and wraps one system call.

#[cfg(target_os = "linux")]
mod linux;
mod policy;
#[cfg(target_os = "linux")]
mod signal;
#[cfg(target_os = "linux")]
mod sync_shim;

#[cfg(target_os = "linux")]
pub use linux::{
    affinity::{CpuSet, affinity, set_affinity},
    clock,
    enforcer::{
        Account, Enforcement, Enforcer, EnforcerConfig, EnforcerStats, EnrollError, MAX_REPL,
        Meter, OverrunSamples, OverrunSummary, STALL, Stall, Stopped, Usage,
    },
    granted::{Granted, GrantedPolicy, granted},
    machine::{Machine, Preemption, machine},
    memory,
    pi_mutex::{PiMutex, PiMutexGuard},
    poll::{PollFd, WakeFd, poll},
    privilege,
    sched::{SchedClass, demote_to_tail, promote, set_priority},
    spawn_error::SpawnError,
    switches::{Drained, Switch, SwitchKind, SwitchLog, voluntary_switches},
    tcp::connect_tcp,
    thread::{Thread, ThreadSpec, spawn},
    tid::{Tid, current_tid},
    timer, tty,
};
/// What others build on: here to be measured against, not to be used.
#[cfg(target_os = "linux")]
pub mod baseline {
    pub use crate::linux::bare_futex::BareFutex;
    pub use crate::linux::cpu_timer::CpuTimer;
}
pub use policy::{MAX_PRIORITY, MIN_RUNTIME, Policy, PolicyError};
#[cfg(target_os = "linux")]
pub use signal::Signal;
pub use sporadic::{Level, Low, Nanos, ParamError, Params};
