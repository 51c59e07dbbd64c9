//! The agent without sockets and clocks: datagrams and time in, datagrams out.
//!
//! ```text
//!   receive ──► session? ──no──► login: CREATE_CLIENT, ping ──────────► replies ─┐
//!                  │ yes                                                         │ first
//!                  ▼                                                             ▼
//!               inlet (order, fragments) ──► requests: CREATE, READ_DATA, ..    pump ──► datagrams
//!                                               │ WRITE_DATA                     ▲
//!                                               ▼                                │ one datagram per
//!                                    topics ──► queues of readers ──► outlets ───┘ client and turn
//! ```
//!
//! Nothing here can fail: what is wrong is dropped, refused or answered with a status, and counted.

mod login;
mod requests;

use crate::clients::Clients;
use crate::config::{Limits, Nanos};
use crate::entities::ReaderAddress;
use crate::inlet::Inlet;
use crate::replies::Replies;
use crate::sample::Pool;
use crate::stats::{Counters, Stats};
use crate::topics::Topics;
use replenish_xrce::wire::{Message, StreamId};
use std::collections::VecDeque;
use std::hash::Hash;
use std::sync::Arc;

/// The time of an event, on two clocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Now {
    /// Nanoseconds on a monotonic clock; the agent's timers go by it.
    pub monotonic: Nanos,
    /// Nanoseconds since the Unix epoch; what clients that synchronise their clocks are told.
    pub unix: i64,
}

/// The agent as a state machine. `P` is where a datagram comes from or goes to.
///
/// Call [`receive`](Self::receive) for every datagram that has arrived, then
/// [`pump`](Self::pump) until it returns false, and both again when a datagram arrives or
/// [`next_deadline`](Self::next_deadline) has come. Not thread-safe; one thread owns it.
#[derive(Debug)]
pub struct AgentCore<P> {
    limits: Limits,
    clients: Clients<P>,
    topics: Topics<ReaderAddress>,
    pool: Pool,
    replies: Replies<P>,
    /// The clients that may have something to send, each once.
    line: VecDeque<usize>,
    counters: Arc<Counters>,
}

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// An agent without clients.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            clients: Clients::new(limits.clients),
            topics: Topics::new(),
            pool: Pool::new(limits.queued_bytes),
            replies: Replies::new(),
            line: VecDeque::with_capacity(limits.clients),
            counters: Arc::default(),
        }
    }

    /// Takes in a datagram from `peer`.
    pub fn receive(&mut self, now: Now, peer: P, datagram: &[u8]) {
        self.counters.datagrams_in.hit();
        let Ok(message) = Message::parse(datagram) else {
            self.counters.malformed.hit();
            return;
        };
        let header = message.header;
        if header.session.is_none() {
            self.outside(now, peer, &message);
            return;
        }
        let Some(index) = self.clients.by_route(peer, header.session) else {
            self.counters.no_session.hit();
            return;
        };
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        if header.key.is_some_and(|key| key != client.key) {
            self.counters.no_session.hit();
            return;
        }
        client.heard(now.monotonic, &self.limits);
        if header.stream == StreamId::NONE {
            self.requests(now, index, StreamId::NONE, message.submessages());
        } else if let Some(inlet) = client.take_inlet(header.stream, &self.limits) {
            self.receive_on(now, index, inlet, &message);
        } else {
            self.counters.unsupported.hit();
        }
        self.stand_in_line(index);
    }

    fn receive_on(&mut self, now: Now, index: usize, mut inlet: Inlet, message: &Message<'_>) {
        let stream = inlet.stream();
        let received = inlet.receive(message.header.seq, message.body, |submessage| {
            self.request(now, index, stream, submessage);
        });
        if received.is_err() {
            self.counters.malformed.hit();
        }
        if let Some(client) = self.clients.get_mut(index) {
            client.put_back(inlet);
        }
    }

    /// Does what is due at `now` and hands up to `max` datagrams to `send`, to each client in
    /// turn. Returns whether there may be more to send.
    pub fn pump(&mut self, now: Now, max: usize, send: &mut dyn FnMut(&P, &[u8])) -> bool {
        self.attend(now.monotonic);
        for _ in 0..max {
            if self.replies.send_one(send) {
                self.counters.datagrams_out.hit();
                continue;
            }
            let Some(index) = self.line.pop_front() else {
                return false;
            };
            let Some(client) = self.clients.get_mut(index) else {
                continue;
            };
            client.queued = false;
            if client.send_one(now.monotonic, &self.limits, &self.counters, send) {
                self.counters.datagrams_out.hit();
                self.stand_in_line(index);
            }
        }
        !(self.replies.is_empty() && self.line.is_empty())
    }

    /// When [`pump`](Self::pump) must be called at the latest although nothing was received.
    #[must_use]
    pub fn next_deadline(&self) -> Option<Nanos> {
        self.clients
            .iter()
            .map(|client| client.deadline(&self.limits))
            .min()
    }

    /// What was counted so far.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.counters.snapshot()
    }

    pub(crate) fn counters(&self) -> &Arc<Counters> {
        &self.counters
    }

    /// Forgets clients that were silent for too long; lets those whose time has come stand in line.
    fn attend(&mut self, now: Nanos) {
        let limits = self.limits;
        let due = |client: &crate::client::Client<P>| client.deadline(&limits) <= now;
        let due: Vec<usize> = self
            .clients
            .iter_mut()
            .filter(|(_, c)| due(c))
            .map(|(index, _)| index)
            .collect();
        for index in due {
            let dead = self
                .clients
                .get_mut(index)
                .is_some_and(|c| c.dies_at(&limits) <= now);
            if dead {
                self.counters.clients_reaped.hit();
                self.remove(index);
            } else {
                self.stand_in_line(index);
            }
        }
    }

    fn stand_in_line(&mut self, index: usize) {
        if let Some(client) = self.clients.get_mut(index).filter(|client| !client.queued) {
            client.queued = true;
            self.line.push_back(index);
        }
    }

    /// Ends a session.
    fn remove(&mut self, index: usize) {
        if let Some(mut client) = self.clients.remove(index) {
            client.close(&mut self.topics);
            self.line.retain(|waiting| *waiting != index);
            self.counters.clients.set(self.clients.len());
        }
    }
}
