//! Counts panicked threads: a back end halts each, and the others go on.

use crate::Tid;
use core::sync::atomic::{AtomicU32, Ordering};

static COUNT: AtomicU32 = AtomicU32::new(0);
static LAST: AtomicU32 = AtomicU32::new(0);

/// Panics so far.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Panicked {
    /// Number of threads that were halted.
    pub count: u32,
    /// The last of them.
    pub last: Option<Tid>,
}

/// Number of panicked threads, and the last one.
#[must_use]
pub fn panicked() -> Panicked {
    Panicked {
        count: COUNT.load(Ordering::Acquire),
        last: Tid::new(LAST.load(Ordering::Acquire).cast_signed()),
    }
}

/// Thread `id` has panicked; 0 is none of ours.
pub(crate) fn count(id: i32) {
    COUNT.fetch_add(1, Ordering::AcqRel);
    LAST.store(id.cast_unsigned(), Ordering::Release);
}
