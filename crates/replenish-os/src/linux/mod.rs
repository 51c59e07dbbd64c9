//! The Linux back end: one topic per file, each a thin safe wrapper around a few system calls.

pub(crate) mod affinity;
pub(crate) mod bare_futex;
pub mod clock;
pub(crate) mod cpu_timer;
pub(crate) mod enforcer;
pub(crate) mod futex;
pub(crate) mod granted;
pub(crate) mod machine;
pub mod memory;
pub(crate) mod pi_mutex;
pub(crate) mod poll;
pub mod privilege;
pub(crate) mod sched;
mod sched_attr;
pub(crate) mod spawn_error;
pub(crate) mod switches;
mod sys;
pub(crate) mod tcp;
pub(crate) mod thread;
pub(crate) mod tid;
pub mod timer;
pub mod tty;
