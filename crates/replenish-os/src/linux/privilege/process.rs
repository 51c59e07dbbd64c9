//! The privileges of this process, asked of the kernel.

use super::probes::{self, CgroupRt, Limit};
use crate::MAX_PRIORITY;
use crate::linux::context_switches::ContextSwitchLog;
use crate::linux::sched::{SchedClass, set_priority};
use crate::linux::sched_attr;
use crate::linux::tid::current_tid;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::io;

/// The real-time rights that the kernel grants this process, and the facts behind them.
#[derive(Debug)]
pub struct Privilege {
    /// The highest FIFO priority a thread of this process gets, or the kernel's refusal.
    pub fifo: Result<u8, io::Error>,
    /// Whether a small `SCHED_DEADLINE` reservation is admitted.
    pub deadline: Result<(), io::Error>,
    /// Whether the memory this process has now may be locked; the error names the limit.
    pub memory_lock: Result<(), String>,
    /// Whether context-switch records of own threads can be had ([`ContextSwitchLog`]); without
    /// them blocking inside a callback is seen by the coarser [`crate::voluntary_switches`].
    pub switch_records: Result<(), io::Error>,
    /// `CAP_SYS_NICE` is effective.
    pub cap_sys_nice: bool,
    /// `CAP_IPC_LOCK` is effective.
    pub cap_ipc_lock: bool,
    /// `RLIMIT_RTPRIO`: the highest real-time priority without the capability; 0 is none.
    pub rtprio: Limit,
    /// `RLIMIT_MEMLOCK` in bytes.
    pub memlock: Limit,
    /// Whether the control group of this process may run real-time threads.
    pub cgroup: CgroupRt,
    /// `kernel.sched_rt_runtime_us`: how much of every second real-time threads may use of a CPU,
    /// in microseconds; -1 is all of it.
    pub rt_runtime_us: Option<i64>,
}

impl Privilege {
    /// Whether sporadic and FIFO workers can have the priorities they ask for, 1 to 99.
    #[must_use]
    pub fn real_time(&self) -> bool {
        matches!(self.fifo, Ok(max) if max == MAX_PRIORITY)
    }
}

/// Finds out what this process may do. Takes a few milliseconds and starts two short threads.
#[must_use]
pub fn probe() -> Privilege {
    let rtprio = probes::limit(Resource::Rtprio);
    let caps = probes::effective_capabilities();
    let cap_ipc_lock = caps.contains(probes::CAP_IPC_LOCK);
    let memlock = probes::limit(Resource::Memlock);
    Privilege {
        fifo: on_a_thread(move || highest_fifo(rtprio)),
        deadline: on_a_thread(small_reservation),
        memory_lock: probes::memory_lock(cap_ipc_lock, memlock),
        switch_records: ContextSwitchLog::open(current_tid()).map(drop),
        cap_sys_nice: caps.contains(probes::CAP_SYS_NICE),
        cap_ipc_lock,
        rtprio,
        memlock,
        cgroup: probes::cgroup(),
        rt_runtime_us: probes::read_number("/proc/sys/kernel/sched_rt_runtime_us"),
    }
}

/// Whether a thread of this process can have a real-time priority at all; quicker than [`probe`].
#[must_use]
pub fn may_be_real_time() -> bool {
    let rtprio = probes::limit(Resource::Rtprio);
    on_a_thread(move || highest_fifo(rtprio)).is_ok()
}

/// Raises the soft limit `RLIMIT_RTPRIO` to the hard one, so that priorities can still be given
/// when the capability is gone: after `setuid(2)`, for instance. Needs no privilege, and does
/// nothing where the hard limit is as low.
pub(crate) fn keep_priorities() {
    raise(Resource::Rtprio);
}

fn raise(resource: Resource) {
    let limit = getrlimit(resource);
    let raised = Rlimit {
        current: limit.maximum,
        ..limit
    };
    // The kernel does not refuse this. If a sandbox does, the watchdog reports the consequences.
    if limit.current != limit.maximum {
        setrlimit(resource, raised).ok();
    }
}

fn on_a_thread<T: Send + 'static>(
    f: impl FnOnce() -> io::Result<T> + Send + 'static,
) -> io::Result<T> {
    let thread = std::thread::Builder::new()
        .name("rt-probe".into())
        .spawn(f)?;
    thread
        .join()
        .unwrap_or_else(|_| Err(io::Error::other("the probe thread panicked")))
}

/// The highest FIFO priority the calling thread gets. It leaves the thread in the class.
fn highest_fifo(rtprio: Limit) -> io::Result<u8> {
    let me = current_tid();
    let refused = match set_priority(me, SchedClass::Fifo(MAX_PRIORITY)) {
        Ok(()) => return Ok(MAX_PRIORITY),
        Err(e) => e,
    };
    match rtprio.soft.and_then(|limit| u8::try_from(limit).ok()) {
        Some(limit) if (1..MAX_PRIORITY).contains(&limit) => {
            set_priority(me, SchedClass::Fifo(limit)).map(|()| limit)
        }
        _ => Err(refused),
    }
}

/// Asks for 0.1 % of one CPU.
fn small_reservation() -> io::Result<()> {
    let mut attr = sched_attr::empty();
    attr.sched_policy = libc::SCHED_DEADLINE.cast_unsigned();
    (attr.sched_runtime, attr.sched_deadline, attr.sched_period) =
        (100_000, 100_000_000, 100_000_000);
    sched_attr::set(current_tid(), &attr)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Raises a limit on which no test depends.
    #[test]
    #[cfg_attr(miri, ignore = "has no limits")]
    fn a_soft_limit_goes_up_to_the_hard_one() {
        let before = getrlimit(Resource::Core);
        let low = Rlimit {
            current: Some(0),
            ..before
        };
        setrlimit(Resource::Core, low).unwrap();
        raise(Resource::Core);
        let raised = getrlimit(Resource::Core);
        assert_eq!(raised.current, before.maximum);
        assert_eq!(raised.maximum, before.maximum);
        setrlimit(Resource::Core, before).unwrap();
    }
}
