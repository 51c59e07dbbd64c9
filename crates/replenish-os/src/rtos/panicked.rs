//! How many threads panicked: a back end halts each, and the others go on.

use crate::Tid;
use core::sync::atomic::{AtomicU32, Ordering};

static COUNT: AtomicU32 = AtomicU32::new(0);
static LAST: AtomicU32 = AtomicU32::new(0);

/// Panics so far.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Panicked {
    /// How many threads were halted.
    pub count: u32,
    /// The last of them.
    pub last: Option<Tid>,
}

/// How many threads panicked, and which one last.
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
