//! In the place of `mailbox` in builds without feature `full`: no command comes for a worker.

use crate::executor::wake::doorbell::{Doorbell, WakeHandle};
use crate::sync::Arc;

/// There is none.
#[derive(Clone, Copy)]
pub(crate) enum Command {}

/// The way to one worker's handles.
pub(crate) struct Mailbox {
    bell: Arc<Doorbell>,
}

impl Mailbox {
    pub(crate) fn new(_: usize, _: usize, bell: Arc<Doorbell>) -> Arc<Self> {
        Arc::new(Self { bell })
    }

    /// Wakes the worker for the handle in `slot`.
    pub(crate) fn wake_handle(&self, slot: usize) -> WakeHandle {
        WakeHandle::new(&self.bell, slot)
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn open(&self) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn is_waiting(&self) -> bool {
        false
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn next(&self) -> Option<Command> {
        None
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn close(&self) {}
}
