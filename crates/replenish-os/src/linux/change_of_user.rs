//! The change of a thread's user, as the C library makes it: by a signal to every thread, whose
//! handler calls the kernel. A thread that does not get the CPU keeps that signal pending.

use super::sched::{SchedClass, set_priority};
use super::sched_attr;
use crate::{MAX_PRIORITY, Tid};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use rustix::thread::{CapabilitySet, CapabilitySets, set_capabilities, set_keep_capabilities};
use std::fs;
use std::io;

/// The signal of the GNU C library, and that of musl.
const SIGNAL: u32 = if cfg!(target_env = "musl") { 34 } else { 33 };

/// Whether the thread has yet to change.
pub(crate) fn is_pending(tid: Tid) -> bool {
    let status = fs::read_to_string(format!("/proc/self/task/{tid}/status"));
    status.is_ok_and(|status| has_pending(&status))
}

fn has_pending(status: &str) -> bool {
    let line = status.lines().find_map(|line| line.strip_prefix("SigPnd:"));
    let bits = line.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok());
    bits.is_some_and(|bits| bits >> (SIGNAL - 1) & 1 == 1)
}

/// All threads of this process.
pub(crate) fn threads() -> impl Iterator<Item = Tid> {
    let tasks = fs::read_dir("/proc/self/task").into_iter().flatten();
    tasks
        .flatten()
        .filter_map(|task| Tid::new(task.file_name().to_str()?.parse().ok()?))
}

/// A program that may set a limit keeps the right to give its threads any priority.
pub(crate) fn keep_limit() {
    let all = Some(MAX_PRIORITY.into());
    if getrlimit(Resource::Rtprio)
        .maximum
        .is_some_and(|m| Some(m) < all)
    {
        let limit = Rlimit {
            current: all,
            maximum: all,
        };
        setrlimit(Resource::Rtprio, limit).ok(); // refused, a refused raise is an event later
    }
}

/// The calling thread can still [take its right back](take_right_back) when it has changed.
pub(crate) fn keep_right() {
    set_keep_capabilities(true).ok(); // refused, it helps those that change before it
}

/// The calling thread may give priorities to threads of any user, and nothing else.
fn take_right_back() {
    let nice = CapabilitySet::SYS_NICE;
    let sets = CapabilitySets {
        effective: nice,
        permitted: nice,
        inheritable: CapabilitySet::empty(),
    };
    set_capabilities(None, sets).ok();
}

/// The policy of a thread.
pub(crate) struct PolicyBefore(libc::sched_attr);

impl PolicyBefore {
    /// `None` for a thread that has ended, and for one that gets the CPU in any case.
    pub(crate) fn of(tid: Tid) -> Option<Self> {
        let attr = sched_attr::get(tid).ok()?;
        let deadline = libc::SCHED_DEADLINE.cast_unsigned();
        (attr.sched_policy != deadline).then_some(Self(attr))
    }

    pub(crate) fn restore(&self, tid: Tid) -> io::Result<()> {
        with_right(|| sched_attr::set(tid, &self.0))
    }
}

/// Gives a thread a priority, with any user that it has by now.
pub(crate) fn give(tid: Tid, class: SchedClass) -> io::Result<()> {
    with_right(|| set_priority(tid, class))
}

fn with_right(call: impl Fn() -> io::Result<()>) -> io::Result<()> {
    match call() {
        Err(e) if e.raw_os_error() == Some(libc::EPERM) => {
            take_right_back();
            call()
        }
        done => done,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pending_signal_is_found_among_others() {
        let status =
            |bits: u64| format!("Name:\tw\nSigQ:\t0/9\nSigPnd:\t{bits:016x}\nShdPnd:\t0\n");
        assert!(has_pending(&status(1 << (SIGNAL - 1) | 1)));
        assert!(!has_pending(&status(1 << SIGNAL)));
        assert!(!has_pending("SigPnd:\tnothing"));
    }
}
