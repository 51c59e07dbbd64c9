//! Times and intervals.

/// `time` and `by` more, at most the last moment there is.
#[cfg_attr(not(feature = "std"), inline(never))]
pub(crate) const fn later(time: Nanos, by: Nanos) -> Nanos {
    time.saturating_add(by)
}

/// A time that never comes. Comparisons need no `Option` with it.
pub(crate) const NEVER: Nanos = Nanos::MAX;

/// A time, if it ever comes.
pub(crate) const fn ever(time: Nanos) -> Option<Nanos> {
    if time == NEVER { None } else { Some(time) }
}

/// Nanoseconds on whatever monotonic clock the caller uses; only differences matter.
pub type Nanos = u64;
