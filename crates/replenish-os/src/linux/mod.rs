//! The Linux back end: one topic per file, each a thin safe wrapper around a few system calls.

pub(crate) mod affinity;
#[cfg(feature = "baseline")]
pub(crate) mod bare_futex;
mod blocked_intervals;
pub(crate) mod blocking_detector;
pub mod clock;
pub(crate) mod config;
pub(crate) mod console;
pub(crate) mod context_switches;
#[cfg(feature = "baseline")]
pub(crate) mod cpu_timer;
pub(crate) mod datagram;
pub(crate) mod futex;
pub(crate) mod granted;
pub(crate) mod machine_info;
pub mod memory;
pub(crate) mod pi_lock;
pub(crate) mod poll;
pub mod privilege;
pub(crate) mod sched;
mod sched_attr;
pub(crate) mod spawn_error;
pub(crate) mod steal_time;
pub(crate) mod suspend;
mod sys;
pub(crate) mod tcp;
pub(crate) mod thread;
pub(crate) mod tid;
pub mod timer;
pub mod tty;
pub(crate) mod wait_set;

pub(crate) use config::OsError;
pub use context_switches::voluntary_switches;
