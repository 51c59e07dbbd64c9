//! Messages, refusals and ends that an encrypted port hands to the agent's core.

use super::arrived::Arrived;
use super::peer::Peer;
use crate::agent_core::AgentCore;
use crate::report::Reason;
use replenish_xrce::wire::ClientKey;

/// Kept for its memory.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// Decrypted messages.
    pub(super) messages: Arrived,
    refused: Vec<(Peer, Option<ClientKey>, Reason)>,
    gone: Vec<Peer>,
}

#[cfg_attr(
    not(feature = "secure"),
    expect(dead_code, reason = "only encrypted ports find something")
)]
impl Found {
    /// Refuses a handshake, or ends a session.
    pub(super) fn refuse(&mut self, peer: Peer, key: Option<ClientKey>, reason: Reason) {
        self.refused.push((peer, key, reason));
    }

    /// A peer is gone for good.
    pub(super) fn end(&mut self, peer: Peer) {
        self.gone.push(peer);
    }

    /// Tells the core of refusals and ends. The messages stay.
    pub(super) fn tell(&mut self, core: &mut AgentCore<Peer>) {
        for (peer, key, reason) in self.refused.drain(..) {
            if matches!(reason, Reason::Handshake(_) | Reason::Handshakes { .. }) {
                core.counters().handshakes_refused.hit();
            }
            core.note(peer, key, reason);
        }
        for peer in self.gone.drain(..) {
            core.gone(|other| *other == peer);
        }
    }
}
