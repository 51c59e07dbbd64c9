//! What every wrapper of this back end shares: error numbers, retries, time conversion.

use crate::Nanos;
use std::io;

const NANOS_PER_SEC: u64 = 1_000_000_000;

/// Turns the `-1` of a system call into the error the kernel left in `errno`.
#[inline]
pub(super) fn check<T: PartialEq + From<i8>>(rc: T) -> io::Result<T> {
    if rc == T::from(-1) {
        Err(io::Error::last_os_error())
    } else {
        Ok(rc)
    }
}

/// Calls `f` again for as long as a signal handler interrupts it.
#[inline]
pub(super) fn retry<T>(mut f: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    loop {
        match f() {
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            done => return done,
        }
    }
}

/// The `errno` of the last failed call of this thread.
pub(super) fn errno() -> i32 {
    io::Error::last_os_error().raw_os_error().unwrap_or(0)
}

/// `t` as the kernel wants it; times a 32-bit `time_t` cannot hold become its end.
#[inline]
pub(super) fn timespec(t: Nanos) -> libc::timespec {
    libc::timespec {
        tv_sec: (t / NANOS_PER_SEC).try_into().unwrap_or(i32::MAX.into()),
        tv_nsec: libc::c_long::try_from(t % NANOS_PER_SEC).unwrap_or(0),
    }
}

/// `ts` in nanoseconds; negative times are 0.
#[inline]
pub(super) fn nanos(ts: &libc::timespec) -> Nanos {
    let secs = u64::try_from(ts.tv_sec).unwrap_or(0);
    secs.saturating_mul(NANOS_PER_SEC)
        .saturating_add(u64::try_from(ts.tv_nsec).unwrap_or(0))
}

/// A zeroed `timespec`.
pub(super) const fn zero_timespec() -> libc::timespec {
    libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timespec_round_trips_and_saturates() {
        for t in [0, 1, 999_999_999, 1_000_000_000, 12_345_678_901_234_567] {
            assert_eq!(nanos(&timespec(t)), t);
        }
        assert_eq!(nanos(&timespec(u64::MAX)), u64::MAX);
    }

    #[test]
    fn check_reads_errno_only_on_failure() {
        assert_eq!(check(0_i32).ok(), Some(0));
        assert!(check(-1_i32).is_err());
        assert!(check(-1_i64).is_err());
    }
}
