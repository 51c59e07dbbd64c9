//! How many peers an endpoint has, those of this participant included.

use super::adapter::Rtps;
use crate::middleware::{ReaderId, WriterId};
use replenish_rtps::endpoint::{Reader, Writer};

impl Rtps {
    pub(super) fn count_readers(&self, writer: WriterId) -> Option<usize> {
        // A thread that waits for a peer may be the only one that looks after discovery.
        self.look_after_discovery();
        let state = self.state.lock();
        let id = state.writers.get(usize::from(writer.0))?.id?;
        state.participant.writer(id).map(Writer::matched)
    }

    pub(super) fn count_writers(&self, reader: ReaderId) -> Option<usize> {
        self.look_after_discovery();
        let state = self.state.lock();
        let id = state.readers.get(usize::from(reader.0))?.id?;
        state.participant.reader(id).map(Reader::matched)
    }
}
