//! In the place of `std/sleeping.rs` without feature `std`: no future sleeps.

use crate::Nanos;
use alloc::sync::Arc;

/// There are none.
#[derive(Default)]
pub(crate) struct Alarms;

/// Polls a future.
pub(crate) fn polling<R>(_alarms: &Arc<Alarms>, poll: impl FnOnce() -> R) -> R {
    poll()
}

impl Alarms {
    pub(crate) const fn next(&self) -> Option<Nanos> {
        None
    }

    pub(crate) const fn expire(&self, _now: Nanos) -> bool {
        false
    }
}
