//! Times in nanoseconds.

/// Nanoseconds, of `CLOCK_MONOTONIC` or of a thread's CPU clock.
pub type Nanos = u64;

/// One millisecond.
pub const MS: Nanos = 1_000_000;

/// One second.
pub const SEC: Nanos = 1_000_000_000;
