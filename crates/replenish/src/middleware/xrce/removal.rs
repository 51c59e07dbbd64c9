//! Endpoints that go: what the agent is told, and what is free again.
//!
//! ```text
//!   reader: slot (ReaderId) ── object number        deleted: the slot is free at once,
//!             0 ──────────────── 17                 the number only after 4094 others, so that a
//!             1 ──────────────── 18                 sample on its way finds nobody
//! ```
//!
//! The agent is told on the dispatcher's next round at the latest: what its stream has no room for now
//! waits in a list.

use super::endpoints::{MAX_NUMBER, Reader, Writer};
use super::state::State;
use crate::middleware::{MAX_READERS, MiddlewareError, ReaderId, WriterId};
use crate::platform::label;
use alloc::vec::Vec;
use replenish_xrce::wire::{ObjectId, ObjectKind, StreamId};

/// The highest object number: ids have twelve bits, and 0 is taken by none here.
const LAST: u16 = 0xffe;

/// Object numbers of one kind, given out in turn.
#[derive(Debug, Default)]
pub(super) struct Numbers {
    last: u16,
}

impl Numbers {
    /// The next number that `is_taken` does not know.
    pub(super) fn next(&mut self, is_taken: impl Fn(u16) -> bool) -> Option<u16> {
        for _ in 0..LAST {
            self.last = self.last % LAST + 1;
            if !is_taken(self.last) {
                return Some(self.last);
            }
        }
        None
    }
}

/// The reader of each object number, `u16::MAX` for none.
#[derive(Debug, Default)]
pub(super) struct Slots(Vec<u16>);

impl Slots {
    pub(super) fn get(&self, number: u16) -> u16 {
        let slot = self.0.get(usize::from(number));
        slot.copied().unwrap_or(u16::MAX)
    }

    fn set(&mut self, number: u16, slot: u16) {
        let number = usize::from(number);
        if self.0.len() <= number {
            self.0.resize(number + 1, u16::MAX);
        }
        if let Some(entry) = self.0.get_mut(number) {
            *entry = slot;
        }
    }
}

/// What is to be deleted, and has not been sent.
#[derive(Debug)]
pub(super) struct Doomed(Vec<(ObjectId, Option<StreamId>)>);

impl Doomed {
    pub(super) fn new() -> Self {
        // Each has a subscriber or publisher and may be the last of its topic.
        Self(Vec::with_capacity(6 * MAX_READERS))
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl State {
    /// An object number for a writer.
    pub(super) fn writer_number(&mut self) -> Result<u16, MiddlewareError> {
        let (what, limit) = (label("writers"), MAX_NUMBER);
        let full = MiddlewareError::Capacity { what, limit };
        let writers = &self.ends.writers;
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
        let free = self.ends.readers.iter().position(|r| r.deleted);
        let slot = free.unwrap_or(self.ends.readers.len());
        let readers = &self.ends.readers;
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
        self.ends.slots.set(reader.object.number(), id);
        match self.ends.readers.get_mut(slot) {
            Some(place) => *place = reader,
            None => self.ends.readers.push(reader),
        }
        ReaderId(id)
    }

    /// Forgets a reader: its slot is free. Who it was.
    pub(super) fn release_reader(&mut self, id: ReaderId) -> Option<ObjectId> {
        let reader = self.ends.readers.get_mut(usize::from(id.0))?;
        if core::mem::replace(&mut reader.deleted, true) {
            return None;
        }
        let (object, topic) = (reader.object, reader.topic.take());
        reader.flow = None;
        self.ends.slots.set(object.number(), u16::MAX);
        self.forget(id);
        for writer in self.ends.writers.iter_mut().filter(|w| w.object == object) {
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
            self.doomed.0.push((object, behind));
        }
    }

    /// Deletes a reader here and at the agent.
    pub(super) fn delete_reader(&mut self, id: ReaderId) {
        let before = self.doomed.0.len();
        let Some(object) = self.release_reader(id) else {
            return;
        };
        // In the order in which they depend on each other; the topic, if it goes, comes last.
        let doomed = &mut self.doomed.0;
        match object.kind() {
            Ok(ObjectKind::DataReader) => {
                let subscriber = ObjectId::new(object.number(), ObjectKind::Subscriber);
                doomed.insert(before, (object, None));
                doomed.insert(before + 1, (subscriber, None));
            }
            _ => {
                let mut writers = self.ends.writers.iter();
                let stream = writers.find(|w| w.object == object).map(|w| w.stream);
                doomed.insert(before, (object, stream)); // behind its last reply
            }
        }
        self.bury();
    }

    /// A writer is used by nobody any more. That of a service goes with its object; until then the
    /// slot is taken.
    pub(super) fn delete_writer(&mut self, id: WriterId) {
        let writer = self.ends.writers.get_mut(usize::from(id.0));
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
        self.doomed.0.push((object, behind));
        self.doomed.0.push((publisher, behind));
        if let Some(topic) = topic {
            self.leave_topic(topic, behind);
        }
        self.bury();
    }

    /// Puts a writer where there is room.
    pub(super) fn place_writer(&mut self, writer: Writer) -> WriterId {
        let free = self.ends.writers.iter().position(|w| w.free);
        let slot = free.unwrap_or(self.ends.writers.len());
        match self.ends.writers.get_mut(slot) {
            Some(place) => *place = writer,
            None => self.ends.writers.push(writer),
        }
        WriterId(u16::try_from(slot).unwrap_or(u16::MAX))
    }

    /// Tells the agent what is to be deleted, as far as there is room for it.
    pub(super) fn bury(&mut self) {
        let session = &mut self.session;
        let mut room = true;
        self.doomed.0.retain(|(object, behind)| {
            room = room
                && match behind {
                    Some(stream) => session.delete_behind(*object, *stream).is_ok(),
                    None => session.delete(*object).is_ok(),
                };
            !room
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_again_after_all_others() {
        let mut numbers = Numbers::default();
        let free = |_: u16| false;
        assert_eq!(numbers.next(free), Some(1));
        assert_eq!(numbers.next(|n| n == 2), Some(3), "2 is taken");
        for expected in 4..=LAST {
            assert_eq!(numbers.next(free), Some(expected));
        }
        assert_eq!(numbers.next(free), Some(1));
        assert_eq!(numbers.next(|_| true), None);
    }
}
