//! The Linux back end: one topic per file, each a thin safe wrapper around a few system calls.

pub(crate) mod affinity;
pub mod clock;
mod futex;
pub(crate) mod pi_mutex;
pub(crate) mod sched;
mod sys;
pub(crate) mod tid;
pub mod timer;
