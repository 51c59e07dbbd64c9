//! Helpers of every wrapper in this back end: error numbers, retries, time conversion.

use crate::Nanos;
use rustix::time::Timespec;
use std::io;

pub(super) const NANOS_PER_SEC: u64 = 1_000_000_000;

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

/// `t` as the kernel wants it.
#[inline]
pub(super) fn timespec(t: Nanos) -> Timespec {
    Timespec {
        tv_sec: (t / NANOS_PER_SEC).cast_signed(), // below 2^35
        tv_nsec: (t % NANOS_PER_SEC).cast_signed(),
    }
}

/// The kernel's time; `None` before 1970.
#[inline]
pub(super) fn nanos(t: &libc::timespec) -> Option<Nanos> {
    let (seconds, rest) = (
        Nanos::try_from(t.tv_sec).ok()?,
        Nanos::try_from(t.tv_nsec).ok()?,
    );
    seconds.checked_mul(NANOS_PER_SEC)?.checked_add(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_timespec_holds_every_time() {
        for t in [
            0,
            1,
            999_999_999,
            1_000_000_000,
            12_345_678_901_234_567,
            u64::MAX,
        ] {
            let split = timespec(t);
            let sum = i128::from(split.tv_sec) * 1_000_000_000 + i128::from(split.tv_nsec);
            assert_eq!(sum, i128::from(t));
            assert!((0..1_000_000_000).contains(&split.tv_nsec));
        }
    }

    #[test]
    fn check_reads_errno_only_on_failure() {
        assert_eq!(check(0_i32).ok(), Some(0));
        assert!(check(-1_i32).is_err());
        assert!(check(-1_i64).is_err());
    }
}
