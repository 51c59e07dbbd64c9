//! The time, read on first use: most handles do not need it.

use crate::Nanos;
use core::cell::Cell;
use replenish_os::clock;

/// One instant of `CLOCK_MONOTONIC`, the same for every call.
#[derive(Default)]
pub(crate) struct LazyNow(Cell<Option<Nanos>>);

impl LazyNow {
    #[cfg(test)]
    pub(crate) fn at(now: Nanos) -> Self {
        Self(Cell::new(Some(now)))
    }

    pub(crate) fn get(&self) -> Nanos {
        let now = self.0.get().unwrap_or_else(clock::monotonic);
        self.0.set(Some(now));
        now
    }
}
