//! A log-in with the key of a session at another address: it is taken over only if the old address
//! does not answer.
//!
//! ```text
//!   log-in elsewhere ──► old address is asked, 3 times in 0.75 s; the new one gets no answer yet
//!                           ├─ something came from there ──► DENIED
//!                           └─ nothing ──► the next log-in has the session
//! ```

use super::state::AgentCore;
use crate::report::Reason;
use replenish_xrce::Nanos;
use replenish_xrce::wire::{ClientKey, Status};
use std::hash::Hash;

/// The verdict on a log-in with the key of a session.
pub(super) enum Takeover {
    /// The log-in may go on: the session is its own, or the session's address does not answer.
    Granted,
    /// The answer to it; `None` while it is not known whether the old address lives.
    Refused(Option<Status>),
}

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// Whether `peer` may have the session of `key`, which the client in slot `index` has.
    pub(super) fn takeover(
        &mut self,
        now: Nanos,
        peer: P,
        key: ClientKey,
        index: usize,
    ) -> Takeover {
        let Some(client) = self.clients.get_mut(index) else {
            return Takeover::Granted;
        };
        if client.peer == peer {
            return Takeover::Granted;
        }
        match client.challenge_met(now) {
            Some(true) => {
                client.challenged = None;
                self.counters.takeovers_refused.hit();
                self.note(peer, Some(key), Reason::TakeoverRefused);
                Takeover::Refused(Some(Status::DENIED))
            }
            Some(false) => {
                self.counters.takeovers.hit();
                self.note_of(index, Reason::Takeover { from: true });
                self.note(peer, Some(key), Reason::Takeover { from: false });
                Takeover::Granted
            }
            None => {
                if client.challenged.is_none() {
                    client.challenge(now);
                    self.serve(now, index);
                }
                Takeover::Refused(None)
            }
        }
    }
}
