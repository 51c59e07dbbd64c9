//! Sending on a best-effort stream: one message under construction.

use super::push::{PushError, Tail, size_within};
use crate::SeqNum;
use crate::wire::StreamHeader;
use crate::wire::{Encode, append};

/// The sending end of a best-effort stream. `S` holds one message.
#[derive(Debug)]
pub struct OutputBestEffort<S> {
    buf: S,
    mtu: usize,
    header: StreamHeader,
    tail: Tail,
    /// Bytes of the message under construction; 0 if there is none.
    len: usize,
    next: SeqNum,
}

impl<S: AsRef<[u8]> + AsMut<[u8]>> OutputBestEffort<S> {
    /// A stream at its beginning; no message is longer than `buf`.
    pub const fn new(buf: S, header: StreamHeader, tail: Tail) -> Self {
        OutputBestEffort {
            buf,
            mtu: usize::MAX,
            header,
            tail,
            len: 0,
            next: SeqNum(0),
        }
    }

    /// The same with no message longer than `mtu`.
    #[must_use]
    pub fn limited(self, mtu: usize) -> Self {
        OutputBestEffort { mtu, ..self }
    }

    /// Back to the beginning, for a new session.
    pub fn reset(&mut self, header: StreamHeader) {
        self.header = header;
        self.len = 0;
        self.next = SeqNum(0);
    }

    /// The session and the stream, as the header of each message has them.
    pub const fn header(&self) -> StreamHeader {
        self.header
    }

    /// The largest submessage, header included, that can be sent.
    pub fn limit(&self) -> usize {
        self.buf
            .as_ref()
            .len()
            .min(self.mtu)
            .saturating_sub(self.header.session.header_len())
    }

    /// Appends a submessage to the message under construction.
    ///
    /// # Errors
    /// [`PushError::WouldBlock`] if it fits only once the message has been taken,
    /// [`PushError::TooLarge`] if it never fits, [`PushError::Wire`].
    pub fn push<B: Encode + ?Sized>(&mut self, body: &B) -> Result<(), PushError> {
        let limit = self.limit();
        size_within(limit, body)?;
        let begun = self.header.session.header_len();
        let room = self.buf.as_mut().get_mut(..limit.wrapping_add(begun));
        let (room, pad) = (room.unwrap_or_default(), self.tail.is_padded());
        self.len = append(room, self.len.max(begun), body, pad).ok_or(PushError::WouldBlock)?;
        Ok(())
    }

    /// Whether there is a message to take.
    pub const fn has_message(&self) -> bool {
        self.len > 0
    }

    /// Takes the message for sending.
    pub fn take(&mut self) -> Option<&[u8]> {
        if self.len == 0 {
            return None;
        }
        let len = core::mem::take(&mut self.len);
        let message = self.buf.as_mut().get_mut(..len)?;
        self.header.put(self.next, message);
        self.next = self.next.plus(1);
        Some(message)
    }
}
