//! Back-pressure: a reliable keep-all writer waits for a keep-all reader that has no room.
//!
//! ```text
//!   sample for a full reader ──► PRESSED: messages of that stream are not taken, not acknowledged
//!                                   │ the reader has room, is gone, or patience is over
//!                                   ▼
//!                                ACKNACK names what was not taken; the client sends it again
//! ```

use super::state::{AgentCore, Pressed};
use crate::entities::Address;
use replenish_xrce::Nanos;
use replenish_xrce::SeqNum;
use replenish_xrce::wire::StreamId;
use std::hash::Hash;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// Lets a stream from a client wait for `reader`.
    pub(super) fn press(&mut self, now: Nanos, client: usize, stream: StreamId, reader: Address) {
        let same = |p: &Pressed| (p.client, p.stream, p.reader) == (client, stream, reader);
        if stream.is_reliable() && !self.pressed.iter().any(same) {
            self.pressed.push(Pressed {
                client,
                until: now.saturating_add(self.limits.patience),
                stream,
                reader,
            });
        }
    }

    /// Whether a message cannot be taken now; it is then noted for later.
    pub(super) fn is_held_up(
        &mut self,
        now: Nanos,
        client: usize,
        stream: StreamId,
        seq: SeqNum,
    ) -> bool {
        self.relieve(now);
        let of_this = |p: &Pressed| (p.client, p.stream) == (client, stream);
        self.pressed.iter().any(of_this)
            && self
                .clients
                .get_mut(client)
                .and_then(|client| client.inlet(stream))
                .is_some_and(|inlet| inlet.postpone(seq))
    }

    /// Lets those go on whose readers have room again.
    pub(super) fn relieve(&mut self, now: Nanos) {
        let mut at = 0;
        while let Some(pressed) = self.pressed.get(at) {
            let Address { client, object } = pressed.reader;
            let patience = self.limits.patience;
            let reader = self
                .clients
                .get_mut(client)
                .and_then(|client| client.entities.reader(object));
            let waiting = reader.is_some_and(|reader| reader.is_pressed(now, patience));
            if waiting && now < pressed.until {
                at += 1;
                continue;
            }
            let Pressed { client, stream, .. } = self.pressed.swap_remove(at);
            let others = |p: &Pressed| (p.client, p.stream) == (client, stream);
            if self.pressed.iter().any(others) {
                continue;
            }
            if let Some(inlet) = self.clients.get_mut(client).and_then(|c| c.inlet(stream)) {
                inlet.resume();
            }
            self.serve(now, client);
        }
    }
}
