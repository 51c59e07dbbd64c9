//! The Linux back end: one topic per file, each a thin safe wrapper around a few system calls.

pub(crate) mod affinity;
pub(crate) mod bare_futex;
mod blocked_intervals;
pub(crate) mod blocking_detector;
pub mod clock;
pub(crate) mod context_switches;
pub(crate) mod cpu_timer;
pub(crate) mod datagram;
pub(crate) mod futex;
pub(crate) mod granted;
pub(crate) mod machine;
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

pub use context_switches::voluntary_switches;
use std::io::Write as _;

/// What a refused system call answers.
pub(crate) type OsError = std::io::Error;

/// Pending replenishments of a budget at most.
pub(crate) const MAX_REPL: usize = 128;
/// Budgeted workers of an enforcer unless said otherwise.
pub(crate) const ENFORCER_CAPACITY: usize = 64;
/// Stack of an enforcer in bytes.
pub(crate) const ENFORCER_STACK: usize = 256 * 1024;
/// Whether blocking inside callbacks is always seen exactly.
pub(crate) const ALWAYS_EXACT: bool = false;
/// How many of the newest overruns of a worker are kept.
pub(crate) const OVERRUNS_KEPT: usize = 1024;

/// Says what went wrong where nobody is there to be told.
pub(crate) fn complain(what: std::fmt::Arguments<'_>) {
    // Where standard error is a pipe that nobody reads any more, it is not said.
    writeln!(std::io::stderr(), "replenish: {what}").ok();
}
