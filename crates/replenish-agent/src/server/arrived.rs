//! The messages of one read of a link, one behind the other in memory that is used again.

use super::peer::Peer;
use std::ops::Range;

/// Received bytes: at most one read, and a message that was waiting for its end.
#[derive(Debug, Default)]
pub(super) struct Arrived {
    bytes: Vec<u8>,
    messages: Vec<(Peer, Range<usize>)>,
}

impl Arrived {
    pub(super) fn push(&mut self, from: Peer, message: &[u8]) {
        let start = self.bytes.len();
        self.bytes.extend_from_slice(message);
        self.messages.push((from, start..self.bytes.len()));
    }

    /// The messages in the order in which they came.
    pub(super) fn iter(&self) -> impl Iterator<Item = (Peer, &[u8])> {
        let messages = self.messages.iter();
        messages.map(|(from, range)| (*from, self.bytes.get(range.clone()).unwrap_or_default()))
    }

    pub(super) fn clear(&mut self) {
        self.bytes.clear();
        self.messages.clear();
    }
}
