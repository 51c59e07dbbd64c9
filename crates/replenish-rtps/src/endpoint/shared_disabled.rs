//! No memory is shared: nothing is offered, referred to or fetched.

use super::peer_writer::PeerWriter;
use super::reader::Reader;
use crate::wire::{
    EntityId, Guid, INFINITE, MessageWriter, Nanos, SegmentName, SequenceNumber, SharedPlace,
    WireError,
};

pub(super) const fn refer(
    _: &mut MessageWriter<'_>,
    _: (EntityId, EntityId),
    _: (SequenceNumber, usize, usize),
    place: SharedPlace,
    _: &[u8],
) -> Result<(), WireError> {
    match place {}
}

impl PeerWriter {
    pub(super) const fn answers_at(&self) -> Nanos {
        if self.ack { self.ack_at } else { INFINITE }
    }

    #[expect(clippy::unused_self, reason = "as with the feature `shared`")]
    pub(super) const fn say(&mut self) -> Option<bool> {
        None
    }
}

#[expect(clippy::unused_self, reason = "as with the feature `shared`")]
impl Reader {
    /// A matched writer shares no memory.
    pub const fn offer(&mut self, _: Guid, _: Option<SegmentName>) {}

    pub(super) const fn asks_for_references(&mut self, _: usize) {}
}
