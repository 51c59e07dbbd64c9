//! Endpoints that go: what the agent is told, and what is free again.
//!
//! ```text
//!   reader: slot (ReaderId) ── object number        deleted: the slot is free at once,
//!             0 ──────────────── 17                 the number only after 4094 others, so that a
//!             1 ──────────────── 18                 sample on its way finds nobody
//! ```
//!
//! The agent is told on the dispatcher's next round at the latest: what its stream has no room for
//! now waits in a list.

use super::limits::MAX_NUMBER;
use super::objects::{Reader, State, Writer};
use crate::middleware::places::{free_place, put};
use crate::middleware::{MAX_READERS, MiddlewareError, ReaderId, WriterId};
use crate::platform::label;
use replenish_xrce::wire::{ObjectId, ObjectKind, StreamId};

impl State {
    /// An object number for a writer.
    pub(super) fn writer_number(&mut self) -> Result<u16, MiddlewareError> {
        let (what, limit) = (label("writers"), MAX_NUMBER);
        let full = MiddlewareError::Capacity { what, limit };
        let writers = &self.endpoints.writers;
        let taken = |number| {
            let same = |w: &Writer| !w.free && w.object.number() == number;
            writers.iter().any(same)
        };
        let number = self.writer_numbers.next(taken);
        number.filter(|_| writers.len() < limit).ok_or(full)
    }

    /// A free slot for a reader, and an object number.
    pub(super) fn reader_place(&mut self) -> Result<(usize, u16), MiddlewareError> {
        let (what, limit) = (label("readers"), MAX_READERS);
        let full = MiddlewareError::Capacity { what, limit };
        let slot = free_place(&self.endpoints.readers, |r| r.deleted);
        let readers = &self.endpoints.readers;
        let taken = |number| {
            let same = |r: &Reader| !r.deleted && r.object.number() == number;
            readers.iter().any(same)
        };
        let number = self.reader_numbers.next(taken);
        let number = number.filter(|_| slot < MAX_READERS);
        Ok((slot, number.ok_or(full)?))
    }

    /// Puts a reader into its slot.
    pub(super) fn place_reader(&mut self, slot: usize, reader: Reader) -> ReaderId {
        let id = u16::try_from(slot).unwrap_or(u16::MAX);
        self.endpoints.slots.set(reader.object.number(), id);
        put(&mut self.endpoints.readers, slot, reader);
        ReaderId(id)
    }

    /// Nothing waits for this reader any more.
    fn forget(&mut self, id: ReaderId) {
        self.endpoints.pending.remove(id);
        self.endpoints.show_backlog();
    }

    /// Frees a reader's slot. Returns its object.
    pub(super) fn release_reader(&mut self, id: ReaderId) -> Option<ObjectId> {
        let reader = self.endpoints.readers.get_mut(usize::from(id.0))?;
        if core::mem::replace(&mut reader.deleted, true) {
            return None;
        }
        let (object, topic) = (reader.object, reader.topic.take());
        reader.flow = None;
        self.endpoints.slots.set(object.number(), u16::MAX);
        self.forget(id);
        for writer in self
            .endpoints
            .writers
            .iter_mut()
            .filter(|w| w.object == object)
        {
            writer.closed = true;
        }
        if let Some(topic) = topic {
            self.leave_topic(topic, None);
        }
        Some(object)
    }

    /// A reader or writer has left a topic object, which goes with its last user.
    fn leave_topic(&mut self, object: ObjectId, behind: Option<StreamId>) {
        let Some(at) = self.topics.iter().position(|t| t.object == object) else {
            return;
        };
        let Some(topic) = self.topics.get_mut(at) else {
            return;
        };
        topic.users = topic.users.saturating_sub(1);
        if topic.users == 0 {
            self.topics.swap_remove(at);
            self.pending_deletes.0.push((object, behind));
        }
    }

    /// Deletes a reader here and at the agent.
    pub(super) fn delete_reader(&mut self, id: ReaderId) {
        let before = self.pending_deletes.0.len();
        let Some(object) = self.release_reader(id) else {
            return;
        };
        // In the order in which they depend on each other; the topic, if it goes, comes last.
        let pending_deletes = &mut self.pending_deletes.0;
        match object.kind() {
            Ok(ObjectKind::DataReader) => {
                let subscriber = ObjectId::new(object.number(), ObjectKind::Subscriber);
                pending_deletes.insert(before, (object, None));
                pending_deletes.insert(before + 1, (subscriber, None));
            }
            _ => {
                let mut writers = self.endpoints.writers.iter();
                let stream = writers.find(|w| w.object == object).map(|w| w.stream);
                pending_deletes.insert(before, (object, stream)); // behind its last reply
            }
        }
        self.flush_deletes();
    }

    /// A writer is used by nobody any more. That of a service goes with its object; until then the
    /// slot is taken.
    pub(super) fn delete_writer(&mut self, id: WriterId) {
        let writer = self.endpoints.writers.get_mut(usize::from(id.0));
        let Some(writer) = writer.filter(|w| !w.free) else {
            return;
        };
        if writer.object.kind() != Ok(ObjectKind::DataWriter) {
            writer.free = writer.closed;
            return;
        }
        (writer.closed, writer.free) = (true, true);
        let (object, stream, topic) = (writer.object, writer.stream, writer.topic.take());
        let publisher = ObjectId::new(object.number(), ObjectKind::Publisher);
        // Behind its last sample; what is best effort may be lost, and this must not be.
        let behind = stream.is_reliable().then_some(stream);
        self.pending_deletes.0.push((object, behind));
        self.pending_deletes.0.push((publisher, behind));
        if let Some(topic) = topic {
            self.leave_topic(topic, behind);
        }
        self.flush_deletes();
    }

    /// Puts a writer where there is room.
    pub(super) fn place_writer(&mut self, writer: Writer) -> WriterId {
        let slot = free_place(&self.endpoints.writers, |w| w.free);
        put(&mut self.endpoints.writers, slot, writer);
        WriterId(u16::try_from(slot).unwrap_or(u16::MAX))
    }

    /// Tells the agent what is to be deleted, as far as there is room for it.
    pub(super) fn flush_deletes(&mut self) {
        let session = &mut self.session;
        let mut room = true;
        self.pending_deletes.0.retain(|(object, behind)| {
            room = room
                && match behind {
                    Some(stream) => session.delete_behind(*object, *stream).is_ok(),
                    None => session.delete(*object).is_ok(),
                };
            !room
        });
    }
}
