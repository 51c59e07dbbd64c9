//! The chains of the callback that runs on the calling thread.

use crate::handoff::Origins;
use core::cell::Cell;

thread_local! {
    static CURRENT: Cell<Origins> = const { Cell::new(Origins::NONE) };
}

/// The origins that a sample takes along that is published now.
#[inline]
pub(crate) fn current() -> Origins {
    CURRENT.get()
}

/// Samples that are published from now on take these along.
#[inline]
pub(crate) fn resume(origins: Origins) {
    CURRENT.set(origins);
}
