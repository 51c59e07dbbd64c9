//! The confirmation of messages (see [`DeliveryTracker`](crate::flow::DeliveryTracker)), and the
//! samples that are kept for readers of returning clients.
//!
//! After an agent's end its clients return within a second or two, in any order, and writers with
//! unconfirmed samples repeat them at once. Samples of a returned client are kept for readers that
//! come later, and are not confirmed, until as many clients have returned as the client expects, or
//! until [`Limits::recovery_window`](crate::Limits::recovery_window) is over.

use super::state::AgentCore;
use crate::clients::ClientOrigin;
use crate::entities::Writer;
use replenish_xrce::Nanos;
use std::hash::Hash;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// Begins the recovery window with the agent's first event.
    pub(super) fn begin(&mut self, now: Nanos) {
        let recovery_window = self.limits.recovery_window;
        let until = &mut self.recovery_window.until;
        until.get_or_insert(now.saturating_add(recovery_window));
    }

    /// Drops samples that no returning reader can need, and confirms messages to their writers.
    pub(super) fn confirm(&mut self, now: Nanos) {
        if self.stashed && self.recovery_window.deadline().is_some_and(|at| at <= now) {
            self.stashed = false;
            for index in self.clients.at(|_| true) {
                let returns = self.returns(now, index);
                let client = self.clients.get_mut(index);
                let mut writers = client.into_iter().flat_map(|c| c.entities.writers());
                if returns {
                    self.stashed |= writers.any(|writer| writer.has_stash());
                } else {
                    writers.for_each(Writer::clear_stash);
                }
            }
            if self.recovery_window.equipped.is_some_and(|at| at <= now) {
                self.recovery_window.equipped = None;
            }
        }
        while let Some((index, _)) = self.confirmed.take() {
            if let Some(client) = self.clients.get_mut(index) {
                client.confirm(now, &self.counters);
                self.serve(now, index);
            }
        }
    }

    /// The latest time at which the message that is being received counts as confirmed.
    pub(super) fn confirmed_at(&mut self, now: Nanos, index: usize) -> Nanos {
        let usual = now.saturating_add(self.limits.confirm_timeout);
        let until = self.recovery_window.until;
        let recovery_window = until.filter(|_| self.returns(now, index));
        recovery_window.map_or(usual, |until| until.max(usual))
    }

    /// Whether the client has returned from another agent, so recently that others may follow.
    pub(super) fn returns(&mut self, now: Nanos, index: usize) -> bool {
        let client = self.clients.get_mut(index);
        match client.and_then(|client| client.origin) {
            Some(ClientOrigin::Returned(companions)) => {
                !self.recovery_window.is_over(now, companions)
            }
            Some(ClientOrigin::New) | None => false,
        }
    }

    /// Counts the clients that ask for confirmations.
    pub(super) fn count_companions(&mut self) {
        let all = self.clients.iter().filter(|client| client.origin.is_some());
        self.recovery_window.here = u8::try_from(all.count()).unwrap_or(u8::MAX);
    }
}
