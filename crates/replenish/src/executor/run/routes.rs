//! The dispatcher's routes: a sample goes from its reader to its handle.

use crate::executor::handles::filler::Filler;
use crate::executor::handles::state::HandleState;
use crate::executor::wake::doorbell::WakeHandle;
use crate::handoff::SampleInfo;
use crate::sync::Arc;

/// The way of a reader's samples to their handle.
pub(crate) struct Route {
    pub(crate) filler: Filler,
    /// Marks the handle, and leads to the bell.
    pub(crate) wake: WakeHandle,
}

impl Route {
    pub(crate) const fn new(shared: Arc<HandleState>, wake: WakeHandle) -> Self {
        let filler = Filler::new(shared);
        Self { filler, wake }
    }

    /// The handle.
    pub(crate) const fn shared(&self) -> &Arc<HandleState> {
        &self.filler.shared
    }

    /// Puts a sample into the inbox, and marks the handle. Whether the reader is to leave the
    /// interest set, since there is no room for another.
    pub(crate) fn deliver(&mut self, info: &SampleInfo, bytes: &[u8]) -> bool {
        let is_full = self.filler.deliver(info, bytes);
        self.wake.mark();
        is_full
    }
}
