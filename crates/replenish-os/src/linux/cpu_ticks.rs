//! A timer of the kernel that interrupts one CPU again and again, whatever runs there.
//!
//! `perf_event_open(2)` with the software event `CPU_CLOCK` and a sampling period: without a buffer
//! it records nothing, but its timer rings (`perf_swevent_hrtimer` in the kernel's trace). One that
//! rings late shows that the CPU stood still.
#![expect(unsafe_code, reason = "perf_event_open")]

use super::context_switches::{Attr, FLAG_FD_CLOEXEC};
use super::sys;
use crate::Nanos;
use std::io;
use std::os::fd::{FromRawFd, OwnedFd};

/// The timer, until dropped.
#[derive(Debug)]
pub struct CpuTicks(#[expect(dead_code, reason = "closing it ends the timer")] OwnedFd);

impl CpuTicks {
    /// Interrupts CPU `cpu` every `period` ns from now on; the kernel allows no less than 10 µs.
    ///
    /// # Errors
    /// `EACCES` or `EPERM` where `kernel.perf_event_paranoid` or a container forbids it, `ENOSYS`
    /// without perf in the kernel, `ENODEV` for a CPU that is not there.
    pub fn start(cpu: usize, period: Nanos) -> io::Result<Self> {
        let attr = Attr::ticks(period);
        let cpu = i32::try_from(cpu).map_err(io::Error::other)?;
        let (any_thread, no_group) = (-1, -1);
        let (attr, cloexec) = (&raw const attr, FLAG_FD_CLOEXEC);
        // SAFETY: `attr` lives across the call and states its own size.
        let fd = sys::check(unsafe {
            libc::syscall(
                libc::SYS_perf_event_open,
                attr,
                any_thread,
                cpu,
                no_group,
                cloexec,
            )
        })?;
        let fd = i32::try_from(fd).map_err(io::Error::other)?;
        // SAFETY: the descriptor is new, open and owned by nobody else.
        Ok(Self(unsafe { OwnedFd::from_raw_fd(fd) }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cpu_that_is_not_there_is_refused() {
        assert!(CpuTicks::start(1 << 20, 50_000).is_err());
    }
}
