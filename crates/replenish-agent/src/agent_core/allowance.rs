//! The bytes that may leave for an address that has not shown that it receives.
//!
//! ```text
//!   datagram of n bytes ──► allowance = 3 n, and what its session has left ──► replies spend it
//!                                                    session's credit ◄── the rest of it
//! ```

use super::state::AgentCore;
use crate::report::Reason;
use replenish_xrce::wire::{ClientKey, Encode, SessionId};
use std::hash::Hash;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// Peers for which `connected` is true receive what is sent to them: their transport has shown
    /// it. Without this there are none.
    #[must_use]
    pub fn connected(self, connected: fn(&P) -> bool) -> Self {
        Self { connected, ..self }
    }

    /// Whether nothing limits the bytes for `peer`.
    pub(super) fn is_trusted(&self, peer: &P) -> bool {
        self.limits.reflection == 0 || (self.connected)(peer)
    }

    /// A datagram of `bytes` has come from `peer`, in the session in slot `index` if there is one.
    pub(super) fn earn(&mut self, peer: &P, bytes: usize, index: Option<usize>) {
        let earned = bytes.saturating_mul(self.limits.reflection as usize);
        let client = index.and_then(|index| self.clients.get(index));
        self.allowance = match client.map(|client| client.echo.credit()) {
            Some(Some(credit)) => credit.saturating_add(earned),
            None if !self.is_trusted(peer) => earned,
            _ => usize::MAX,
        };
    }

    /// The rest of the allowance is for the session in slot `index`.
    pub(super) fn keep_allowance(&mut self, index: usize) {
        if let Some(client) = self.clients.get_mut(index) {
            client.echo.set_credit(self.allowance);
        }
    }

    /// Queues a reply to the datagram that is being received, as far as it may cause any.
    pub(super) fn reply(
        &mut self,
        peer: P,
        session: SessionId,
        key: ClientKey,
        body: &impl Encode,
    ) {
        let pushed = self.replies.push(peer, session, key, body, self.allowance);
        if let Some(bytes) = pushed {
            if self.allowance != usize::MAX {
                self.allowance = self.allowance.saturating_sub(bytes);
            }
            return;
        }
        self.counters.replies_dropped.hit();
        if self.allowance < crate::clients::LONGEST_REPLY {
            let limit = self.limits.reflection;
            self.note(peer, Some(key), Reason::Reflection { limit });
        }
    }
}
