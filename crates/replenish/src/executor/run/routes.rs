//! Where the dispatcher brings samples.

use crate::event::{Event, Events};
use crate::executor::handles::state::HandleState;
use crate::executor::wake::doorbell::WakeHandle;
use crate::handoff::{DeliveryOutcome, RingSlot, SampleInfo};
use crate::sync::Arc;

/// Where a reader's samples go.
pub(crate) struct Route {
    pub(crate) shared: Arc<HandleState>,
    /// Marks the handle, and leads to the bell.
    pub(crate) wake: WakeHandle,
    /// The dispatcher's empty buffer for its next sample.
    pub(crate) spare_slot: Option<RingSlot>,
}

impl Route {
    /// Puts a sample into the inbox, and marks the handle. Whether the reader is to leave the
    /// interest set, since there is no room for another.
    pub(crate) fn deliver(&mut self, info: &SampleInfo, bytes: &[u8], events: &Events) -> bool {
        let Some((_, inbox)) = &self.shared.input else {
            return false;
        };
        let counters = &self.shared.counters;
        counters.received.count(1);
        let delivery = inbox.deliver(&mut self.spare_slot, bytes, info);
        self.wake.mark();
        match delivery.outcome {
            DeliveryOutcome::Stored => {}
            DeliveryOutcome::ReplacedOldest | DeliveryOutcome::NoRoom => {
                counters.dropped.add(1);
            }
            DeliveryOutcome::Closed => {
                counters.discarded.add(1);
            }
            DeliveryOutcome::Oversize => self.oversize(bytes.len(), events),
        }
        delivery.parked
    }

    /// A sample has come that is too long for the handle, and that the middleware did not keep.
    #[cfg(feature = "texts")]
    #[cold]
    pub(crate) fn refuse(&self, size: usize, events: &Events) {
        self.shared.counters.received.count(1);
        self.oversize(size, events);
    }

    #[cold]
    fn oversize(&self, size: usize, events: &Events) {
        let count = self.shared.counters.oversize.add(1);
        let handle = &self.shared.id;
        let event = Event::Oversize {
            handle,
            size,
            count,
        };
        self.shared.report(count, &event, events);
    }
}
