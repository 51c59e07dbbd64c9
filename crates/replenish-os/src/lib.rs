//! The operating-system edge of replenish: the only crate with `unsafe`, beside the C interface.
//!
//! - [`Policy`], [`ThreadSpec`], [`spawn`], [`granted`]: threads that have what was asked before
//!   they run user code, and what the kernel says they have.
//! - [`Notify`]: the hand-off cell that one thread waits on.
//! - [`Enforcer`], [`Account`], [`Meter`]: budgets held by lowering and raising priorities.
//! - [`foreign`]: budgets for threads of other programs (Linux).
//! - [`ContextSwitchLog`], [`voluntary_switches`]: was a thread preempted, or did it block?
//! - [`PiMutex`]: a lock with priority inheritance.
//! - [`clock`], [`timer`]: monotonic time, CPU clocks of this and other threads, absolute sleep,
//!   one-shot timers.
//! - [`poll`], [`WakeFd`], `SocketSet`: waiting on descriptors, and waking such a wait.
//! - [`connect_tcp`]: TCP without waiting for the other side.
//! - [`tty`]: serial lines and pseudo-terminals; [`Terminal`]: drawing on the user's.
//! - [`config`]: the error of a setting that is out of its range.
//! - [`memory`]: locking memory and touching stacks, so that page faults stay out.
//! - `SegmentWriter`, `SegmentReader`: memory from which other processes fetch samples.
//! - [`live`], [`BudgetRecord`]: memory that others may read, and what is recorded of a budget.
//! - [`recorder`]: the same on a board, with feature `recorder`.
//! - [`Tid`], [`current_tid`], [`set_affinity`], [`affinity`]: naming and placing threads.
//! - [`SchedClass`], [`set_priority`], [`promote`], [`demote_to_tail`]: what an enforcer does to
//!   the threads it watches.
//! - [`privilege`], [`machine_info`]: the privileges of this process, the commands that grant the
//!   missing ones, and the kind of machine. [`change_user`]: giving them up while budgets are held.
//!
//! Time is `u64` nanoseconds of `CLOCK_MONOTONIC` ([`Nanos`]) unless said otherwise.
//! Every `unsafe` block lives in a module of its own topic under the back end's directory.
//!
//! # Back ends
//! | | Linux | `freertos` | `nuttx` |
//! |---|---|---|---|
//! | chosen by | target | feature, on targets without an operating system | feature, on `NuttX` targets |
//! | policies, `spawn`, `Thread`, `granted`, `set_priority`, `promote`, `demote_to_tail` | all | FIFO and sporadic | FIFO, RR and sporadic |
//! | `Notify`, `PiMutex`, `clock`, `timer`, `Enforcer`, `Account`, `Meter`, `voluntary_switches` | yes | yes | yes |
//! | `Low::Suspend` | yes | yes | refused at enrolment |
//! | `memory`, `privilege::may_be_real_time` | yes | yes, nothing to do | the same |
//! | `poll`, `PollFd` | descriptors | no: `WakeFd::wait_until` waits for a wake-up alone | the same |
//! | `foreign`, `ContextSwitchLog`, `machine_info`, `steal_time`, affinity, `tty`, `Terminal`, `connect_tcp` | yes | no | no |
//! | heap that can be sealed, panics | no | `freertos` (also start, interrupts) | `nuttx` (also the check at start) |
//!
//! Feature `posix` (default) brings budgets held by the server of POSIX; `compact` small memory
//! functions for images, and errors of small kernels without words; `recorder` the last events of a
//! board's tasks; `outlined` calls instead of copies where interrupts are masked; `baseline` what
//! `replenish-bench` measures against.

#![cfg_attr(not(target_os = "linux"), no_std)]
#![cfg_attr(
    loom,
    allow(
        dead_code,
        unreachable_pub,
        reason = "a model has other locks and clocks"
    )
)]

extern crate alloc;

#[cfg(all(target_os = "none", feature = "freertos"))]
pub mod freertos;
#[cfg(all(target_os = "linux", not(nuttx_host)))]
mod linux;
#[cfg(loom)]
mod modelled;
#[cfg(any(all(target_os = "nuttx", feature = "nuttx"), nuttx_host))]
pub mod nuttx;
#[cfg(any(not(target_os = "linux"), nuttx_host))]
mod rtos;

#[cfg(all(target_os = "none", feature = "freertos"))]
pub(crate) use freertos as backend;
#[cfg(all(target_os = "linux", not(nuttx_host)))]
pub(crate) use linux as backend;
#[cfg(any(all(target_os = "nuttx", feature = "nuttx"), nuttx_host))]
pub(crate) use nuttx as backend;

#[cfg(not(any(target_os = "linux", feature = "freertos", feature = "nuttx")))]
compile_error!(
    "replenish-os has no back end here: use Linux, feature `freertos` on a target without an \
     operating system, or feature `nuttx` on a NuttX target"
);

mod arc;
#[cfg(all(target_os = "linux", not(nuttx_host)))]
pub mod config;
mod enforcer;
mod notify;
mod pi_mutex;
#[cfg_attr(
    any(all(target_os = "linux", not(nuttx_host)), not(feature = "recorder")),
    path = "recorder_disabled.rs"
)]
pub mod recorder;
mod spec;
mod sync_shim;
mod tid;
mod wake_descriptor;

pub use arc::Arc;
#[cfg(any(not(target_os = "linux"), nuttx_host))]
pub use backend::AtomicU64;
#[cfg(all(target_os = "linux", not(nuttx_host)))]
pub use backend::{
    affinity::{CpuSet, affinity, set_affinity},
    context_switches::{ContextSwitch, ContextSwitchLog, Drained, SwitchDirection},
    counted_datagram::{
        Counted, count_drops, cut_datagrams, hear_joined_alone, receive_counted, stamp_arrivals,
    },
    datagram::receive,
    foreign,
    interfaces::{AddressChanges, host_addresses},
    live,
    machine_info::{MachineInfo, Preemption, machine_info},
    poll::{PollFd, poll},
    segment::{Fetched, SegmentReader, SegmentWriter},
    socket_set::SocketSet,
    steal_time::steal_time,
    tcp::{acknowledge_at_once, connect_tcp},
    terminal::Terminal,
    tty,
    wait_set::WaitSet,
};
pub use backend::{
    granted::{Granted, GrantedPolicy, granted},
    memory,
    poll::WakeFd,
    privilege,
    sched::{SchedClass, demote_to_tail, promote, set_priority},
    spawn_error::SpawnError,
    thread::{Thread, spawn},
    timer, voluntary_switches,
};
pub use enforcer::{
    Account, Enforcement, Enforcer, EnforcerConfig, EnforcerStats, EnrollError, Fault, MAX_REPL,
    Meter, OverrunSamples, OverrunSummary, STALL, Stall, Stopped, Usage,
};
#[cfg(all(target_os = "linux", not(nuttx_host)))]
pub use enforcer::{BudgetRecord, change_user};
#[cfg(loom)]
pub use modelled::{PiMutex, PiMutexGuard, clock, current_tid};
pub use notify::Notify;
pub use spec::ThreadSpec;
pub use sporadic::{
    Level, Low, MAX_PRIORITY, MIN_RUNTIME, Nanos, ParamError, Params, Policy, PolicyError,
};
pub use tid::Tid;
#[cfg(not(loom))]
pub use {
    backend::{clock, tid::current_tid},
    pi_mutex::{PiMutex, PiMutexGuard},
};

/// A bare futex and a POSIX CPU timer: `replenish-bench` measures against them. A change of user:
/// it attacks with that. Ticks of a CPU: they show it when the CPU stood still. They stay in this
/// crate because they need `unsafe`.
#[cfg(all(target_os = "linux", not(nuttx_host), feature = "baseline"))]
#[doc(hidden)]
pub mod baseline {
    pub use crate::linux::bare_futex::BareFutex;
    pub use crate::linux::cpu_ticks::CpuTicks;
    pub use crate::linux::cpu_timer::CpuTimer;
    pub use crate::linux::user::become_user;
}
