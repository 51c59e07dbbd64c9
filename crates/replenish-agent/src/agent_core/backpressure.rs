//! Back-pressure: a reliable keep-all writer waits for a keep-all reader that has no room.
//!
//! ```text
//!   sample for a full reader ──► BLOCKED: messages of that stream are not taken, not acknowledged
//!                                   │ the reader has room, or is gone
//!                                   ▼
//!                                ACKNACK names the missing messages; the client repeats them
//! ```
//!
//! A sample is refused before anything is done with it, so what was taken finds room. The wait has
//! no end while both clients live, unless [`Limits::writer_block_limit`](crate::Limits) sets one.

use super::state::{AgentCore, BlockedStream};
use crate::entities::Address;
use replenish_xrce::Nanos;
use replenish_xrce::SeqNum;
use replenish_xrce::wire::StreamId;
use std::hash::Hash;

/// The longest wait of a writer for a reader whose client may wait for the writer in turn, in ns.
const CIRCLE: Nanos = 1_000_000_000;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// Lets a stream from a client wait until `reader` has room for a sample of `bytes`.
    pub(super) fn block(&mut self, client: usize, stream: StreamId, reader: Address, bytes: usize) {
        let same = |p: &BlockedStream| (p.client, p.stream) == (client, stream);
        if !self.blocked_streams.iter().any(same) {
            self.blocked_streams.push(BlockedStream {
                client,
                stream,
                reader,
                bytes,
            });
        }
    }

    /// Whether a reliable keep-all writer has to wait with a sample of `bytes` for this reader.
    pub(super) fn holds_up(
        &mut self,
        now: Nanos,
        reader: Address,
        (bytes, has_waited): (usize, bool),
    ) -> bool {
        let limit = self.block_limit(reader);
        let Some(client) = self.clients.get_mut(reader.client) else {
            return false;
        };
        let endpoint = client.entities.reader(reader.object);
        endpoint.is_some_and(|endpoint| {
            endpoint.holds_up(now, (bytes, has_waited), &client.ledger, limit)
        })
    }

    /// The longest wait of writers for a reader: as long as both live, unless a limit is set, or
    /// the reader's client asks for more samples only on a stream that waits itself. That wait
    /// might never end.
    fn block_limit(&self, reader: Address) -> Option<Nanos> {
        let client = self.clients.get(reader.client);
        let record = client.and_then(|client| client.entities.record(reader.object));
        let asks_on = record.and_then(|record| record.reader.as_deref()?.spent_on());
        let waits = |on| {
            let same = |p: &BlockedStream| (p.client, p.stream) == (reader.client, on);
            self.blocked_streams.iter().any(same)
        };
        let limit = self.limits.writer_block_limit;
        if asks_on.is_some_and(waits) {
            Some(limit.unwrap_or(CIRCLE).min(CIRCLE))
        } else {
            limit
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
            let (reader, bytes) = (blocked.reader, blocked.bytes);
            if self.holds_up(now, reader, (bytes, true)) {
                at += 1;
                continue;
            }
            let BlockedStream { client, stream, .. } = self.blocked_streams.swap_remove(at);
            self.resume(now, client, stream);
            self.serve(now, client);
        }
    }

    /// Time at which a wait for a reader ends although the reader has no room.
    pub(super) fn unblocks_at(&self) -> Option<Nanos> {
        let blocked = self.blocked_streams.iter();
        let ends = blocked.filter_map(|blocked| {
            let Address { client, object } = blocked.reader;
            let record = self.clients.get(client)?.entities.record(object)?;
            let since = record.reader.as_deref()?.full_since?;
            Some(since.saturating_add(self.block_limit(blocked.reader)?))
        });
        ends.min()
    }
}
