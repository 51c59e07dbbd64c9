//! Points and spans of time.

use core::fmt;

/// A point in time or a span of time, in nanoseconds. Which clock is the caller's choice; the
/// same monotonic clock must be used for every call on one server.
pub type Nanos = u64;

/// Prints a span of time in the largest unit that keeps it whole: `30 ms`, `1500 us`, `7 ns`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WholeUnits(pub Nanos);

impl fmt::Display for WholeUnits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let units = [
            ("s", 1_000_000_000),
            ("ms", 1_000_000),
            ("us", 1_000),
            ("ns", 1),
        ];
        for (unit, size) in units {
            if self.0 >= size && self.0.is_multiple_of(size) {
                return write!(f, "{} {unit}", self.0 / size);
            }
        }
        f.write_str("0 ns")
    }
}

/// `time` and `by` more, at most the last moment there is. (Out of line where flash is scarce.)
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline)]
#[must_use]
pub const fn later(time: Nanos, by: Nanos) -> Nanos {
    time.saturating_add(by)
}

/// The time from `before` to `now`; 0 if that is not later.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline)]
#[must_use]
pub const fn since(now: Nanos, before: Nanos) -> Nanos {
    now.saturating_sub(before)
}

/// The later one of two times, or the longer one of two spans.
#[must_use]
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline)]
pub const fn latest(a: Nanos, b: Nanos) -> Nanos {
    if a < b { b } else { a }
}

/// The earlier one of two times, or the shorter one of two spans.
#[must_use]
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline)]
pub const fn earliest(a: Nanos, b: Nanos) -> Nanos {
    if b < a { b } else { a }
}
