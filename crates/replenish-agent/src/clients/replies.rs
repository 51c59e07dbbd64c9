//! Answers that belong to no stream: log-in, ping, time, log-out.
//!
//! They go to an address, not to a client, because some are for peers without a session (yet,
//! or any more).

use replenish_xrce::SeqNum;
use replenish_xrce::wire::{ClientKey, Encode, Header, MessageWriter, SessionId, StreamId};
use std::collections::VecDeque;

/// Replies that may wait at the same time; they are sent before anything else, so that more than
/// one batch of datagrams can ask for is never needed.
const LIMIT: usize = 256;

/// Bytes of the longest reply: INFO with client key.
pub(crate) const LONGEST_REPLY: usize = 64;

/// A bounded queue of encoded datagrams.
#[derive(Debug)]
pub(crate) struct Replies<P> {
    queue: VecDeque<Reply<P>>,
}

#[derive(Debug)]
struct Reply<P> {
    to: P,
    bytes: [u8; LONGEST_REPLY],
    len: usize,
}

impl<P> Replies<P> {
    pub(crate) fn new() -> Self {
        Self {
            queue: VecDeque::with_capacity(LIMIT),
        }
    }

    /// Queues `body` outside of any stream, if it is at most `longest` bytes in a message of its
    /// own; returns the bytes of the message, or `None` without room.
    pub(crate) fn push(
        &mut self,
        to: P,
        session: SessionId,
        key: ClientKey,
        body: &impl Encode,
        longest: usize,
    ) -> Option<usize> {
        let header = Header::new(session, StreamId::NONE, SeqNum(0), key);
        let mut bytes = [0; LONGEST_REPLY];
        let message = MessageWriter::new(&mut bytes, &header).and_then(|mut message| {
            message.push(body)?;
            Ok(message.len())
        });
        match message {
            Ok(len) if self.queue.len() < LIMIT && len <= longest => {
                self.queue.push_back(Reply { to, bytes, len });
                Some(len)
            }
            _ => None,
        }
    }

    /// Hands the oldest reply to `send`; returns whether there was one.
    pub(crate) fn send_one(&mut self, send: &mut dyn FnMut(&P, &[u8])) -> bool {
        let Some(reply) = self.queue.pop_front() else {
            return false;
        };
        send(&reply.to, reply.bytes.get(..reply.len).unwrap_or(&[]));
        true
    }

    /// Drops what waits for some peers.
    pub(crate) fn forget(&mut self, which: impl Fn(&P) -> bool) {
        self.queue.retain(|reply| !which(&reply.to));
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }
}
