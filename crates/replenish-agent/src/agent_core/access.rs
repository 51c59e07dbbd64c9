//! The access list in the state machine: it admits clients, and a new list ends sessions.

use super::state::{AgentCore, Now};
use crate::config::{AccessList, Grant, Limits};
use crate::flow::RateLimiter;
use crate::report::Reason;
use replenish_xrce::wire::ClientKey;
use std::hash::Hash;
use std::sync::Arc;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// The rights of a client at `peer`, `None` without a list; or the part of its log-in that is
    /// not in the list.
    pub(super) fn granted(
        &self,
        peer: &P,
        key: ClientKey,
    ) -> Result<Option<Arc<Grant>>, &'static str> {
        let grant = self
            .access
            .as_ref()
            .map(|list| list.find(key, (self.host)(peer), (self.identity)(peer)));
        Ok(grant.transpose()?.cloned())
    }

    /// The limits of a client with these rights.
    pub(super) fn limits_of(&self, grant: Option<&Arc<Grant>>) -> Limits {
        grant.map_or(self.limits, |grant| grant.limits(&self.limits))
    }

    /// Goes by `list` from now on. The session of a client ends if the client may not log in any
    /// more, or has an entity that it may not have any more; a smaller `memory` counts from its
    /// next log-in.
    pub fn set_access(&mut self, now: Now, list: Option<AccessList>) {
        self.time = now.monotonic;
        self.access = list;
        for index in self.clients.at(|_| true) {
            let Some(client) = self.clients.get(index) else {
                continue;
            };
            let granted = self.granted(&client.peer, client.key);
            let refused = match &granted {
                Err(field) => Some(*field),
                Ok(grant) => {
                    let allows = |plan| grant.as_ref().is_none_or(|grant| grant.allows(plan));
                    let mut entities = client.entities.iter();
                    let all = entities.all(|(_, record)| allows(&record.plan));
                    (!all).then_some("topics")
                }
            };
            if let Some(field) = refused {
                self.counters.denied.hit();
                self.note_of(
                    index,
                    Reason::NotListed {
                        field,
                        session: true,
                    },
                );
                self.remove(index);
                continue;
            }
            let grant = granted.ok().flatten();
            let rate = self.limits_of(grant.as_ref()).datagrams_per_second;
            if let Some(client) = self.clients.get_mut(index) {
                client.rate_limiter = RateLimiter::new(rate);
                client.grant = grant;
            }
        }
    }
}
