//! Virtual time: one clock per model.

pub use crate::linux::clock::{ThreadCpuClock, thread_cpu};

use crate::Nanos;
use std::cell::Cell;

thread_local!(static NOW: Cell<Nanos> = const { Cell::new(0) });

/// Now, in nanoseconds.
#[must_use]
pub fn monotonic() -> Nanos {
    NOW.get()
}

/// Sets the clock. A model sets it first of all, since executions follow one another.
pub fn set(now: Nanos) {
    NOW.set(now);
}

/// Moves the clock to `deadline`, unless it is past it: what a wait does that nothing else ends.
pub fn reach(deadline: Nanos) {
    NOW.set(NOW.get().max(deadline));
}

/// Lets the other threads of the model run. The clock stands still, as it does for any thread
/// that merely passes the time.
pub fn sleep_until(_: Nanos) {
    loom::thread::yield_now();
}
