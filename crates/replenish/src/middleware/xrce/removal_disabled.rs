//! In the place of `removal` in builds without feature `full`: endpoints stay until the end.

use super::limits::{MAX_NUMBER, number};
use super::objects::{Reader, State, Writer};
use crate::middleware::{MAX_READERS, MiddlewareError, ReaderId, WriterId};
use crate::platform::label;

impl State {
    /// An object number for a writer.
    pub(super) fn writer_number(&self) -> Result<u16, MiddlewareError> {
        number(self.endpoints.writers.len(), MAX_NUMBER, label("writers"))
    }

    /// A slot for a reader, and an object number.
    pub(super) fn reader_place(&self) -> Result<(usize, u16), MiddlewareError> {
        let slot = self.endpoints.readers.len();
        Ok((slot, number(slot, MAX_READERS, label("readers"))?))
    }

    /// Puts a reader into its slot.
    pub(super) fn place_reader(&mut self, _: usize, reader: Reader) -> ReaderId {
        let id = self.endpoints.slots.get(reader.object.number());
        self.endpoints.readers.push(reader);
        ReaderId(id)
    }

    /// Puts a writer behind the others.
    pub(super) fn place_writer(&mut self, writer: Writer) -> WriterId {
        // They have the numbers from 1 on, as readers have.
        let id = self.endpoints.slots.get(writer.object.number());
        self.endpoints.writers.push(writer);
        WriterId(id)
    }

    /// It stays; the set-up has failed.
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn delete_reader(&mut self, _: ReaderId) {}

    /// As for a reader.
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn delete_writer(&mut self, _: WriterId) {}

    /// Nothing is to be deleted.
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn flush_deletes(&mut self) {}
}
