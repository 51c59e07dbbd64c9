//! The Linux back end: one topic per file, each a thin safe wrapper around a few system calls.

pub(crate) mod affinity;
pub mod clock;
pub(crate) mod enforcer;
pub(crate) mod futex;
pub(crate) mod granted;
pub(crate) mod pi_mutex;
pub mod privilege;
pub(crate) mod sched;
mod sched_attr;
pub(crate) mod spawn_error;
mod sys;
pub(crate) mod thread;
pub(crate) mod tid;
pub mod timer;
pub(crate) mod switches;
