//! The Linux back end: one topic per file, each a thin safe wrapper around a few system calls.

pub(crate) mod affinity;
pub mod clock;
mod futex;
pub(crate) mod pi_mutex;
pub(crate) mod sched;
mod sys;
pub(crate) mod tid;
pub mod timer;

pub(crate) mod enforcer;
mod stub;
use affinity::{CpuSet, set_affinity};
use clock::ThreadCpuClock;
use pi_mutex::PiMutex;
use sched::{demote_to_tail, promote};
use stub::*;
use tid::{Tid, current_tid};
use timer::TimerFd;
