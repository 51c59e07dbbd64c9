//! Samples in memory that writers share with programs on their host: the participant's owner opens
//! the memory and fetches them, since it alone knows how.

use super::state::{Participant, ReaderId};
use crate::endpoint::Fetch;
use crate::wire::{EntityId, Guid, GuidPrefix, Nanos, Reference, SegmentName, Shared, Timestamp};

impl Participant {
    /// Memory of a matched writer, to be opened: its writer and its name.
    #[must_use]
    pub fn wanted_segment(&self) -> Option<(Guid, SegmentName)> {
        let mut readers = self.readers.iter();
        readers.find_map(|own| own.endpoint.wanted_segment())
    }

    /// The memory of a writer was opened, or cannot be: its samples come in fragments then.
    pub fn segment_opened(&mut self, writer: Guid, open: bool) {
        for own in &mut self.readers {
            own.endpoint.segment_opened(writer, open);
        }
    }

    /// Whether a reader of ours is matched with the writer.
    #[must_use]
    pub fn has_reader_of(&self, writer: Guid) -> bool {
        let mut readers = self.readers.iter();
        readers.any(|own| own.endpoint.writers().any(|guid| guid == writer))
    }

    /// A sample to be fetched: of this reader, or of any one. It goes back with
    /// [`fetched`](Self::fetched).
    pub fn fetch(&mut self, only: Option<ReaderId>) -> Option<Fetch> {
        if !self.referred {
            return None;
        }
        let wanted = |entity| only.is_none_or(|only| only.entity() == entity);
        for own in &mut self.readers {
            if wanted(own.endpoint.guid().entity)
                && let Some(fetch) = own.endpoint.fetch()
            {
                return Some(fetch);
            }
        }
        self.referred &= only.is_some();
        None
    }

    /// Gives a sample back: whether all of its bytes are there. `broken`: the memory of its writer
    /// cannot be read, and later samples are to come in fragments.
    pub fn fetched(&mut self, fetch: Fetch, whole: bool, broken: bool, now: Nanos) {
        let writer = fetch.writer;
        let mut readers = self.readers.iter_mut();
        if let Some(own) = readers.find(|own| own.endpoint.guid() == fetch.reader) {
            own.endpoint.fetched(fetch, whole, broken);
            self.heard(writer.prefix, now);
        }
    }

    /// A reference has come.
    pub(super) fn refer(
        &mut self,
        from: GuidPrefix,
        body: &Reference<'_>,
        source: Option<Timestamp>,
        now: Nanos,
    ) {
        self.heard_writer(Guid::new(from, body.writer), now);
        self.referred = true;
        for own in &mut self.readers {
            let entity = own.endpoint.guid().entity;
            if body.reader == EntityId::UNKNOWN || body.reader == entity {
                own.endpoint.reference(from, body, source);
            }
        }
    }

    /// A reader says whether it takes references.
    pub(super) fn share(&mut self, from: GuidPrefix, body: &Shared) {
        let mut writers = self.writers.iter_mut();
        if let Some(own) = writers.find(|own| own.endpoint.entity() == body.writer) {
            own.endpoint.shared(from, body);
        }
    }
}
