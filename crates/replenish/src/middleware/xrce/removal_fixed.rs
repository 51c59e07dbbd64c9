//! In the place of `removal` in builds without feature `full`: endpoints stay until the end.

use super::endpoints::{MAX_NUMBER, Reader, Writer, number};
use super::state::State;
use crate::middleware::{MAX_READERS, MiddlewareError, ReaderId, WriterId};
use crate::platform::label;

/// Object numbers of one kind, given out in turn.
#[derive(Debug, Default)]
pub(super) struct Numbers {
    last: u16,
}

impl Numbers {
    pub(super) fn next(&mut self, _: impl Fn(u16) -> bool) -> Option<u16> {
        self.last += 1;
        Some(self.last) // a session keeps fewer objects than there are numbers
    }
}

/// Which reader has an object number: they are given out in the same order, slots from 0 on.
#[derive(Debug, Default)]
pub(super) struct Slots(());

impl Slots {
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn get(&self, number: u16) -> u16 {
        number.wrapping_sub(1)
    }
}

/// Nothing is to be deleted.
#[derive(Debug)]
pub(super) struct Doomed;

impl Doomed {
    pub(super) const fn new() -> Self {
        Self
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn is_empty(&self) -> bool {
        true
    }
}

impl State {
    /// An object number for a writer.
    pub(super) fn writer_number(&self) -> Result<u16, MiddlewareError> {
        number(self.ends.writers.len(), MAX_NUMBER, label("writers"))
    }

    /// A slot for a reader, and an object number.
    pub(super) fn reader_place(&self) -> Result<(usize, u16), MiddlewareError> {
        let slot = self.ends.readers.len();
        Ok((slot, number(slot, MAX_READERS, label("readers"))?))
    }

    /// Puts a reader into its slot.
    pub(super) fn place_reader(&mut self, _: usize, reader: Reader) -> ReaderId {
        let id = self.ends.slots.get(reader.object.number());
        self.ends.readers.push(reader);
        ReaderId(id)
    }

    /// Puts a writer behind the others.
    pub(super) fn place_writer(&mut self, writer: Writer) -> WriterId {
        // They have the numbers from 1 on, as readers have.
        let id = self.ends.slots.get(writer.object.number());
        self.ends.writers.push(writer);
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
    pub(super) const fn bury(&mut self) {}
}
