//! [`Filler`]: puts a reader's samples into its handle's inbox, for the one thread that takes them:
//! the dispatcher, or the worker itself.

use super::state::HandleState;
use crate::event::{Event, Events};
use crate::handoff::{DeliveryOutcome, RingSlot, SampleInfo};
use crate::platform::recorder;
use crate::sync::Arc;

/// The way of a reader's samples into the inbox of their handle.
pub(crate) struct Filler {
    pub(crate) shared: Arc<HandleState>,
    /// The empty buffer for the next sample.
    pub(crate) spare_slot: Option<RingSlot>,
    /// Samples that were too long and are not reported yet, and the size of the last one.
    oversize: (u32, usize),
}

impl Filler {
    pub(crate) const fn new(shared: Arc<HandleState>) -> Self {
        Self {
            shared,
            spare_slot: None,
            oversize: (0, 0),
        }
    }

    /// Puts a sample into the inbox. Whether the reader is to leave the interest set, since there
    /// is no room for another.
    pub(crate) fn deliver(&mut self, info: &SampleInfo, bytes: &[u8]) -> bool {
        let Some((_, inbox)) = &self.shared.input else {
            return false;
        };
        let counters = &self.shared.counters;
        counters.received.count(1);
        recorder::take(self.shared.name, info.arrival, bytes.len());
        let delivery = inbox.deliver(&mut self.spare_slot, bytes, info);
        match delivery.outcome {
            DeliveryOutcome::Stored => {}
            DeliveryOutcome::ReplacedOldest | DeliveryOutcome::NoRoom => {
                counters.dropped.add(1);
                recorder::dropped(self.shared.name, info.arrival, bytes.len());
            }
            DeliveryOutcome::Closed => {
                counters.discarded.add(1);
            }
            DeliveryOutcome::Oversize => self.oversize = (self.oversize.0 + 1, bytes.len()),
        }
        delivery.parked
    }

    /// Whether samples were too long that are not reported yet.
    pub(crate) const fn has_oversize(&self) -> bool {
        self.oversize.0 > 0
    }

    /// Reports the samples that were too long, one by one.
    #[cold]
    pub(crate) fn report_oversize(&mut self, events: &Events) {
        let (samples, size) = core::mem::take(&mut self.oversize);
        (0..samples).for_each(|_| self.too_long(size, events));
    }

    /// A sample has come that is too long for the handle, and that the middleware did not keep.
    #[cold]
    pub(crate) fn refuse(&self, size: usize, events: &Events) {
        self.shared.counters.received.count(1);
        self.too_long(size, events);
    }

    #[cold]
    fn too_long(&self, size: usize, events: &Events) {
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
