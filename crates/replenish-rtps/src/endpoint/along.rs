//! Heartbeats and acknowledgements that go along with samples: alone, each of them costs a datagram
//! and a wake-up at the other end.
//!
//! ```text
//!   writer:  DATA HEARTBEAT      a sample takes a heartbeat along, if none went out for 10 ms
//!   reader:  DATA ACKNACK        the answer waits up to 5 ms for a sample to the same participant
//!
//!   a heartbeat that comes alone, or a sample is missing ──► the answer goes at once, by itself
//! ```
//!
//! An answer that was taken along may wait in the socket of a reader that is full. The writer then
//! repeats its heartbeat, alone as soon as it has no sample to send: that one is answered by
//! itself.

use super::peer_reader::PeerReader;
use super::peer_writer::PeerWriter;
use super::reader::Reader;
use super::writer::{FIRST_HEARTBEAT, Writer};
use crate::wire::{Guid, GuidPrefix, INFINITE, MessageWriter, Nanos};
use core::net::SocketAddr;

/// The longest time for which an answer waits for a sample, less than a heartbeat's repetition.
pub(crate) const ANSWER_WAIT: Nanos = FIRST_HEARTBEAT / 2;

/// Whether the participant takes any submessage at any of its addresses: it is of this library.
fn is_ours(prefix: GuidPrefix) -> bool {
    prefix.0.starts_with(&[0, 0])
}

impl Writer {
    /// Whether the samples that are sent now take a heartbeat along.
    pub(super) fn sends_heartbeat_along(&self, now: Nanos) -> bool {
        let fresh = |reader: &PeerReader| reader.reliable && reader.next <= self.history.last();
        now >= self.announced_at.saturating_add(FIRST_HEARTBEAT) && self.readers.iter().any(fresh)
    }

    /// Whether samples went out since `since` that could have taken an answer along, which is for
    /// the participant `prefix` at `to`.
    pub(crate) fn wrote_to(&self, prefix: GuidPrefix, to: SocketAddr, since: Nanos) -> bool {
        let last = self.history.get(self.history.last());
        let reaches = |reader: &PeerReader| {
            reader.guid.prefix == prefix && (reader.to == to || is_ours(prefix))
        };
        last.is_some_and(|(change, _)| change.written >= since) && self.readers.iter().any(reaches)
    }
}

impl Reader {
    /// The address of the answers to a writer.
    pub(crate) fn answers_to(&self, writer: Guid) -> Option<SocketAddr> {
        let known = self.writers.iter().find(|known| known.guid == writer);
        known.map(|known| known.to)
    }

    /// The time at which [`Reader::transmit`] has something to say at the latest.
    pub(crate) fn answers_at(&self) -> Nanos {
        let answers = self.writers.iter().map(PeerWriter::answers_at);
        answers.min().unwrap_or(INFINITE)
    }

    /// Adds the answers that wait for the participant `prefix` to a datagram with samples for it,
    /// as far as they fit.
    pub(crate) fn transmit_along(
        &mut self,
        prefix: GuidPrefix,
        (to, now): (SocketAddr, Nanos),
        m: &mut MessageWriter<'_>,
    ) {
        for at in 0..self.writers.len() {
            let Some(writer) = self.writers.get(at) else {
                return;
            };
            // One that must not be late does not wait in another reader's socket.
            let joins =
                writer.to == to || (writer.ack_at != 0 && !writer.lacks() && is_ours(prefix));
            let ack = writer.ack && writer.guid.prefix == prefix && joins;
            if ack && self.answer(at, now, m).is_none() {
                return;
            }
        }
    }
}
