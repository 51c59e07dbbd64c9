//! The output barrier: what callbacks publish during a round waits here until its end.
//!
//! Its room is allocated at set-up, for a fixed number of samples of a fixed size. A sample that
//! does not fit is an error of the publishing callback, which knows at once.

use crate::handoff::Origins;
use crate::middleware::{Middleware, PublishError, WriterId};
use crate::platform::chain;
use crate::sync::Arc;
use alloc::boxed::Box;
use alloc::vec::Vec;

/// Samples that wait for the end of a round.
pub(crate) struct Outbox {
    slots: Vec<Slot>,
    used: usize,
}

struct Slot {
    bytes: Box<[u8]>,
    len: usize,
    to: Option<(Arc<dyn Middleware>, WriterId)>,
    /// The chains of the callback that published it.
    origins: Origins,
}

impl Outbox {
    /// Room for `samples` of up to `bytes` each.
    pub(crate) fn new(samples: usize, bytes: usize) -> Self {
        let slot = || Slot {
            bytes: alloc::vec![0; bytes].into(),
            len: 0,
            to: None,
            origins: Origins::NONE,
        };
        Self {
            slots: (0..samples).map(|_| slot()).collect(),
            used: 0,
        }
    }

    /// Encodes a sample into the next slot.
    pub(crate) fn keep(
        &mut self,
        middleware: &Arc<dyn Middleware>,
        writer: WriterId,
        encode: impl FnOnce(&mut [u8]) -> Result<usize, PublishError>,
    ) -> Result<(), PublishError> {
        let slot = self.slots.get_mut(self.used).ok_or(PublishError::Full)?;
        slot.len = encode(&mut slot.bytes)?;
        slot.origins = chain::current();
        slot.to = Some((Arc::clone(middleware), writer));
        self.used += 1;
        Ok(())
    }

    /// Sends everything, in the order it was published; tells of each that was not sent.
    pub(crate) fn release(&mut self, mut failed: impl FnMut(PublishError)) {
        for slot in self.slots.iter_mut().take(self.used) {
            let payload = slot.bytes.get(..slot.len).unwrap_or_default();
            chain::resume(slot.origins);
            if let Some((middleware, writer)) = slot.to.take()
                && let Err(e) = middleware.publish(writer, payload)
            {
                failed(e);
            }
        }
        chain::resume(Origins::NONE);
        self.used = 0;
    }
}
