//! Sending samples on the publisher's thread.
//!
//! The lock is held for one datagram at a time, or for sixteen fragments, and never while a long
//! sample is copied or a message is encoded. So a sample of another publisher goes out amid a
//! camera's image.
//!
//! ```text
//!   lock: take the writer's buffer ─ unlock ─ encode into it
//!   lock: the history keeps it, and gives the buffer of its oldest sample ─ first datagram ─ unlock
//! ```

use super::adapter::Rtps;
use super::qos::LONG;
use super::shared::Spare;
use crate::middleware::{PublishError, WriterId};
use replenish_os::clock;
use replenish_rtps::endpoint::{Body, Header, Writer};
use replenish_rtps::participant as rtps;
use replenish_rtps::wire::CDR_LE;

impl Rtps {
    /// Sends a sample of a topic.
    pub(super) fn send_sample(&self, writer: WriterId, payload: &[u8]) -> Result<(), PublishError> {
        let now = clock::monotonic();
        let (id, spare, is_fetched) = {
            let mut state = self.state.lock();
            let (id, end) = state.writer(writer, payload.len())?;
            let long = payload.len() >= LONG;
            // Without a spare one, another thread publishes with the same writer.
            let spare = if long { end.spare.take() } else { None };
            let full = |writer: &Writer| writer.is_full();
            if spare.is_some() && state.participant.writer(id).is_some_and(full) {
                // Refused before the bytes are copied: a publisher may ask often.
                state.give_back(writer, id, spare);
                return Err(PublishError::Full);
            }
            let kept = state.participant.writer(id);
            let is_fetched = kept.is_some_and(Writer::is_fetched);
            if spare.is_none() {
                let parts = Body::Parts(&[&CDR_LE, payload]);
                state.write(id, parts, Header::default(), now)?;
            }
            (id, spare, is_fetched)
        };
        if let Some(mut spare) = spare {
            let len = fill(&mut spare.buffer, payload);
            return self.send_spare((writer, id), (spare, is_fetched), len, now);
        }
        self.send_of(id, now);
        Ok(())
    }

    /// Sends a sample of a topic that `encode` writes into the buffer that the writer then keeps:
    /// the writer's oldest one is the buffer of the next sample. `None` without such a buffer:
    /// another thread publishes with the same writer.
    pub(super) fn encode_sample(
        &self,
        writer: WriterId,
        encode: &mut dyn FnMut(&mut [u8]) -> Option<usize>,
    ) -> Option<Result<(), PublishError>> {
        let now = clock::monotonic();
        let (id, limit, mut spare, is_fetched) = {
            let mut state = self.state.lock();
            let (id, end) = match state.writer(writer, 0) {
                Ok(found) => found,
                Err(error) => return Some(Err(error)),
            };
            let (limit, spare) = (end.limit, end.spare.take()?);
            if state.participant.writer(id).is_some_and(Writer::is_full) {
                // Refused before it is encoded: a publisher may ask often.
                state.give_back(writer, id, Some(spare));
                return Some(Err(PublishError::Full));
            }
            let kept = state.participant.writer(id);
            let is_fetched = kept.is_some_and(Writer::is_fetched);
            (id, limit, spare, is_fetched)
        };
        let (head, rest) = spare.buffer.split_at_mut_checked(CDR_LE.len())?;
        head.copy_from_slice(&CDR_LE);
        let Some(len) = encode(rest.get_mut(..limit).unwrap_or_default()) else {
            self.state.lock().give_back(writer, id, Some(spare));
            return Some(Ok(()));
        };
        let len = CDR_LE.len().saturating_add(len.min(limit));
        Some(self.send_spare((writer, id), (spare, is_fetched), len, now))
    }

    /// Sends a sample with its encapsulation that fills `len` bytes of the writer's buffer.
    fn send_spare(
        &self,
        (writer, id): (WriterId, rtps::WriterId),
        (mut spare, is_fetched): (Spare, bool),
        len: usize,
        now: crate::Nanos,
    ) -> Result<(), PublishError> {
        let tools = (&self.alarm, &self.sockets);
        let shared = spare.share(len, is_fetched);
        let more = {
            let mut state = self.state.lock();
            let body = Body::Buffer(&mut spare.buffer, len);
            let header = Header {
                shared,
                ..Header::default()
            };
            let written = state.write(id, body, header, now);
            state.give_back(writer, id, Some(spare));
            written?;
            state.send_of(id, now, tools)
        };
        if more {
            self.send_of(id, now);
        }
        Ok(())
    }

    /// Sends what a writer has to send: nothing of other writers.
    pub(super) fn send_of(&self, writer: rtps::WriterId, now: crate::Nanos) {
        let tools = (&self.alarm, &self.sockets);
        while self.state.lock().send_of(writer, now, tools) {}
    }
}

/// Puts a sample with its encapsulation into a buffer that is long enough; its length.
fn fill(buffer: &mut [u8], payload: &[u8]) -> usize {
    let len = CDR_LE.len().saturating_add(payload.len());
    if let Some((head, rest)) = buffer.split_at_mut_checked(CDR_LE.len()) {
        head.copy_from_slice(&CDR_LE);
        if let Some(room) = rest.get_mut(..payload.len()) {
            replenish_wire::copy(room, payload);
        }
    }
    len
}
