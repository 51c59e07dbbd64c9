//! Clocks: monotonic time, the CPU time of this and of other threads, absolute sleep.
//!
//! Cost, median on a virtual machine with a TSC clock source: [`monotonic`] 30 ns (no system
//! call), [`thread_cpu`] 0.4 us, [`ThreadCpuClock::read`] 0.2 us for a blocked thread and 0.4 us
//! for one that runs on another CPU; the value is exact in both cases.
#![expect(unsafe_code, reason = "clock_gettime of other threads' clocks")]

use super::sys::{self, NANOS_PER_SEC};
use super::tid::current_tid;
use crate::Nanos;
use crate::Tid;
use rustix::io::Errno;
use rustix::thread::{ClockId, clock_nanosleep_absolute};

/// Now on `CLOCK_MONOTONIC`, in nanoseconds. Any thread; never goes back.
#[inline]
#[must_use]
pub fn monotonic() -> Nanos {
    gettime(libc::CLOCK_MONOTONIC).unwrap_or(0)
}

/// CPU time consumed by the calling thread, in nanoseconds (`CLOCK_THREAD_CPUTIME_ID`).
#[inline]
#[must_use]
pub fn thread_cpu() -> Nanos {
    gettime(libc::CLOCK_THREAD_CPUTIME_ID).unwrap_or(0)
}

/// The CPU clock of one thread of this process; any thread of the process may read it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ThreadCpuClock(libc::clockid_t);

impl ThreadCpuClock {
    /// The clock of the calling thread, to be read by others.
    #[must_use]
    pub fn current() -> Self {
        Self::of(current_tid())
    }

    /// The clock of thread `tid` of this process.
    #[must_use]
    pub const fn of(tid: Tid) -> Self {
        // The kernel's dynamic clock ids (linux/posix-timers_types.h): the complement of the id,
        // then CPUCLOCK_PERTHREAD_MASK (4) | CPUCLOCK_SCHED (2).
        Self((!tid.get() << 3) | 6)
    }

    /// The number that other system calls know the clock by.
    #[cfg(feature = "baseline")]
    pub(super) const fn id(&self) -> libc::clockid_t {
        self.0
    }

    /// CPU time consumed by the thread so far, in nanoseconds; `None` once the thread has ended
    /// (or never was one of this process).
    #[must_use]
    pub fn read(&self) -> Option<Nanos> {
        gettime(self.0)
    }

    /// The same; the time at hand is of no use here.
    pub(crate) fn read_at(&self, _now: Nanos) -> Option<Nanos> {
        self.read()
    }
}

/// Sleeps until [`monotonic`] has reached `t`; returns at once if it has. Signals do not end the
/// sleep early.
pub fn sleep_until(t: Nanos) {
    let t = sys::timespec(t);
    while clock_nanosleep_absolute(ClockId::Monotonic, &t) == Err(Errno::INTR) {}
}

#[inline]
fn gettime(clock: libc::clockid_t) -> Option<Nanos> {
    let mut ts = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: `ts` is writable for the call; an unknown clock id is an error, not a fault.
    let rc = unsafe { libc::clock_gettime(clock, &raw mut ts) };
    (rc == 0).then(|| nanos(&ts))
}

/// Negative times are 0.
#[inline]
fn nanos(ts: &libc::timespec) -> Nanos {
    let secs = u64::try_from(ts.tv_sec).unwrap_or(0);
    secs.saturating_mul(NANOS_PER_SEC)
        .saturating_add(u64::try_from(ts.tv_nsec).unwrap_or(0))
}
