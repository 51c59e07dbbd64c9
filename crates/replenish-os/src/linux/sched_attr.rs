//! `sched_setattr(2)` and `sched_getattr(2)`, which no C library wraps everywhere.
#![expect(unsafe_code, reason = "sched_setattr, sched_getattr")]

use super::sys;
use crate::Tid;
use std::io;

/// The kernel's `struct sched_attr`, version 0, all fields zero.
pub(super) const fn empty() -> libc::sched_attr {
    libc::sched_attr {
        size: size_of::<libc::sched_attr>() as u32,
        sched_policy: 0,
        sched_flags: 0,
        sched_nice: 0,
        sched_priority: 0,
        sched_runtime: 0,
        sched_deadline: 0,
        sched_period: 0,
    }
}

/// Sets policy, parameters and flags of thread `tid`.
pub(super) fn set(tid: Tid, attr: &libc::sched_attr) -> io::Result<()> {
    let attr = &raw const *attr;
    // SAFETY: `attr` names its own size and lives across the call, which only reads it.
    let rc = unsafe { libc::syscall(libc::SYS_sched_setattr, tid.get(), attr, 0) };
    sys::check(rc).map(drop)
}

/// Policy, parameters and flags of thread `tid`.
pub(super) fn get(tid: Tid) -> io::Result<libc::sched_attr> {
    let mut attr = empty();
    let size = attr.size;
    let to = &raw mut attr;
    // SAFETY: the kernel writes at most `size` bytes, the size of the structure.
    let rc = unsafe { libc::syscall(libc::SYS_sched_getattr, tid.get(), to, size, 0) };
    sys::check(rc)?;
    Ok(attr)
}
