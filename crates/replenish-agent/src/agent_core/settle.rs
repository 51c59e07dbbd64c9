//! When what clients write counts as settled (see [`receipt`](crate::receipt)), and what is kept for
//! readers whose clients have lost the agent before this one and are on their way back.
//!
//! After an agent's end its clients return within a second or two, in any order, and those with
//! something to repeat do so at once. What a client writes that has returned is kept for readers
//! that come after it, and does not count as settled, until as many have returned as it says there
//! were, or until [`Limits::comeback`](crate::Limits::comeback) is over.

use super::AgentCore;
use crate::client::Promise;
use crate::config::Nanos;
use crate::entities::Writer;
use std::hash::Hash;

/// So long after a returned client's last request it has created all its readers.
const MOMENT: Nanos = 300_000_000;

/// Who has returned from the agent before this one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Comeback {
    /// Until when clients may return; counted from the agent's first moment.
    until: Option<Nanos>,
    /// How many have.
    returned: usize,
    /// How many there were, as far as those who have returned know.
    expected: u8,
    /// Clients that are told what is settled, up to 255.
    here: u8,
    /// When they have created their readers.
    equipped: Option<Nanos>,
}

impl Comeback {
    /// A client has sent something in its session: it will create its readers now.
    pub(super) fn arrived(&mut self, now: Nanos, delivery: Option<Promise>) {
        if let Some(Promise::Back(companions)) = delivery {
            self.returned += 1;
            self.expected = self.expected.max(companions);
            self.equips(now);
        }
    }

    /// One of them creates something.
    pub(super) fn equips(&mut self, now: Nanos) {
        self.equipped = Some(now.saturating_add(MOMENT));
    }

    /// Whether one that says that there were `companions` need not wait for others any more.
    fn is_over(&self, now: Nanos, companions: u8) -> bool {
        let all = companions > 0 && self.returned >= usize::from(companions);
        let late = |time: Option<Nanos>| time.is_none_or(|time| time <= now);
        late(self.until) || (all && late(self.equipped))
    }

    /// How many clients will return should this agent be lost now.
    pub(super) fn companions(&self, now: Nanos) -> u8 {
        let more = self.until.filter(|until| now < *until);
        more.map_or(self.here, |_| self.here.max(self.expected))
    }

    /// When it may be over for somebody.
    pub(super) fn deadline(&self) -> Option<Nanos> {
        self.equipped.into_iter().chain(self.until).min()
    }
}

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// The agent's first moment has come, if it has not yet.
    pub(super) fn begin(&mut self, now: Nanos) {
        let comeback = self.limits.comeback;
        let until = &mut self.comeback.until;
        until.get_or_insert(now.saturating_add(comeback));
    }

    /// Lets go of what waits for nobody any more, and tells those who have written it.
    pub(super) fn settle(&mut self, now: Nanos) {
        if self.stashed && self.comeback.deadline().is_some_and(|at| at <= now) {
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
            if self.comeback.equipped.is_some_and(|at| at <= now) {
                self.comeback.equipped = None;
            }
        }
        while let Some((index, _)) = self.settled.take() {
            if let Some(client) = self.clients.get_mut(index) {
                client.settle(now, &self.counters);
                self.serve(now, index);
            }
        }
    }

    /// When the message that is being taken in counts as settled at the latest.
    pub(super) fn settles_at(&mut self, now: Nanos, index: usize) -> Nanos {
        let usual = now.saturating_add(self.limits.settle);
        let until = self.comeback.until;
        let comeback = until.filter(|_| self.returns(now, index));
        comeback.map_or(usual, |until| until.max(usual))
    }

    /// Whether the client has returned from another agent, so recently that others may follow.
    pub(super) fn returns(&mut self, now: Nanos, index: usize) -> bool {
        let client = self.clients.get_mut(index);
        match client.and_then(|client| client.delivery) {
            Some(Promise::Back(companions)) => !self.comeback.is_over(now, companions),
            Some(Promise::New) | None => false,
        }
    }

    /// Counts those who are told what is settled.
    pub(super) fn count_companions(&mut self) {
        let all = self
            .clients
            .iter()
            .filter(|client| client.delivery.is_some());
        self.comeback.here = u8::try_from(all.count()).unwrap_or(u8::MAX);
    }
}
