//! Back-pressure: a reliable keep-all writer waits for a keep-all reader that has no room.
//!
//! ```text
//!   sample for a full reader ──► BLOCKED: messages of that stream are not taken, not acknowledged
//!                                   │ the reader has room, is gone, or the time limit is over
//!                                   ▼
//!                                ACKNACK names the missing messages; the client repeats them
//! ```

use super::state::{AgentCore, BlockedStream};
use crate::entities::Address;
use replenish_xrce::Nanos;
use replenish_xrce::SeqNum;
use replenish_xrce::wire::StreamId;
use std::hash::Hash;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// Lets a stream from a client wait for `reader`.
    pub(super) fn block(&mut self, now: Nanos, client: usize, stream: StreamId, reader: Address) {
        let same = |p: &BlockedStream| (p.client, p.stream, p.reader) == (client, stream, reader);
        if stream.is_reliable() && !self.blocked_streams.iter().any(same) {
            self.blocked_streams.push(BlockedStream {
                client,
                until: now.saturating_add(self.limits.writer_block_limit),
                stream,
                reader,
            });
        }
    }

    /// Whether a message cannot be taken now; it is then noted for later.
    pub(super) fn is_blocked(
        &mut self,
        now: Nanos,
        client: usize,
        stream: StreamId,
        seq: SeqNum,
    ) -> bool {
        self.unblock(now);
        let of_this = |p: &BlockedStream| (p.client, p.stream) == (client, stream);
        self.blocked_streams.iter().any(of_this)
            && self
                .clients
                .get_mut(client)
                .and_then(|client| client.input(stream))
                .is_some_and(|input| input.postpone(seq))
    }

    /// Unblocks the streams whose readers have room again.
    pub(super) fn unblock(&mut self, now: Nanos) {
        let mut at = 0;
        while let Some(blocked) = self.blocked_streams.get(at) {
            let Address { client, object } = blocked.reader;
            let patience = self.limits.writer_block_limit;
            let reader = self
                .clients
                .get_mut(client)
                .and_then(|client| client.entities.reader(object));
            let waiting = reader.is_some_and(|reader| reader.blocks_writers(now, patience));
            if waiting && now < blocked.until {
                at += 1;
                continue;
            }
            let BlockedStream { client, stream, .. } = self.blocked_streams.swap_remove(at);
            let others = |p: &BlockedStream| (p.client, p.stream) == (client, stream);
            if self.blocked_streams.iter().any(others) {
                continue;
            }
            if let Some(input) = self.clients.get_mut(client).and_then(|c| c.input(stream)) {
                input.resume();
            }
            self.serve(now, client);
        }
    }
}
