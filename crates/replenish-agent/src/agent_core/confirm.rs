//! When what clients write counts as settled (see [`DeliveryTracker`](crate::flow::DeliveryTracker)), and what is kept for
//! readers whose clients have lost the agent before this one and are on their way back.
//!
//! After an agent's end its clients return within a second or two, in any order, and those with
//! something to repeat do so at once. What a client writes that has returned is kept for readers
//! that come after it, and does not count as settled, until as many have returned as it says there
//! were, or until [`Limits::recovery_window`](crate::Limits::recovery_window) is over.

use super::state::AgentCore;
use crate::clients::ClientOrigin;
use crate::entities::Writer;
use replenish_xrce::Nanos;
use std::hash::Hash;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// The agent's first moment has come, if it has not yet.
    pub(super) fn begin(&mut self, now: Nanos) {
        let recovery_window = self.limits.recovery_window;
        let until = &mut self.recovery_window.until;
        until.get_or_insert(now.saturating_add(recovery_window));
    }

    /// Lets go of what waits for nobody any more, and tells those who have written it.
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

    /// When the message that is being taken in counts as settled at the latest.
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

    /// Counts those who are told what is settled.
    pub(super) fn count_companions(&mut self) {
        let all = self.clients.iter().filter(|client| client.origin.is_some());
        self.recovery_window.here = u8::try_from(all.count()).unwrap_or(u8::MAX);
    }
}
