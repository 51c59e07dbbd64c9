//! Ids of the model's threads.

use crate::Tid;
use std::sync::atomic::{AtomicI32, Ordering};

/// Only compared with one another, so they may go on counting from one execution to the next.
static NEXT: AtomicI32 = AtomicI32::new(1);

loom::thread_local! {
    static ID: Tid = Tid::known(NEXT.fetch_add(1, Ordering::Relaxed));
}

/// The id of the calling thread of the model.
#[must_use]
pub fn current_tid() -> Tid {
    ID.with(|id| *id)
}
