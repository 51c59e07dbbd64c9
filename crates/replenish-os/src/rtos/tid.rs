//! Numbers of tasks, in the order in which they were made.

use super::slot;
use core::fmt;

/// The number of a task, from 1. Never used again.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct Tid(i32);

impl Tid {
    /// The number `raw`, or `None` if it is not positive.
    #[must_use]
    pub const fn new(raw: i32) -> Option<Self> {
        if raw > 0 { Some(Self(raw)) } else { None }
    }

    /// The plain number.
    #[must_use]
    pub const fn get(self) -> i32 {
        self.0
    }

    pub(crate) const fn of(slot: &slot::Slot) -> Self {
        Self(slot.id)
    }
}

impl fmt::Display for Tid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

/// The number of the calling task. Code that runs outside of tasks (before the kernel starts) is
/// given a number that no task has.
#[must_use]
pub fn current_tid() -> Tid {
    slot::current().map_or(Tid(i32::MAX), Tid::of)
}
