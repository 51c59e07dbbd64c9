//! The core itself: its state, and the way of a datagram in and out.

use super::client_queue::ClientQueue;
use super::recovery_window::RecoveryWindow;
use crate::bridge::Bridge;
use crate::clients::{Clients, InputStream, Replies};
use crate::config::{AccessList, AgentConfig, Limits, Profiles, TopicRule};
use crate::entities::{Address, Topics};
use crate::flow::{ConfirmedStreams, Ledger, Strangers, TrackerHandle};
use crate::report::{Counters, Reason, Recordings, Refusals, RejectionLog, Stats};
use replenish_xrce::wire::{ClientKey, Message, StreamId};
use replenish_xrce::{Nanos, SeqNum};
use std::collections::BTreeSet;
use std::hash::Hash;
use std::net::IpAddr;
use std::sync::Arc;

/// The time of an event, on two clocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Now {
    /// Nanoseconds on a monotonic clock; the agent's timers go by it.
    pub monotonic: Nanos,
    /// Nanoseconds since the Unix epoch, for clients that synchronise their clocks.
    pub unix: i64,
}

/// A stream from a client that waits for a reader.
#[derive(Debug)]
pub(super) struct BlockedStream {
    pub(super) client: usize,
    pub(super) stream: StreamId,
    pub(super) reader: Address,
    /// The bytes of the sample that waits.
    pub(super) bytes: usize,
}

/// The agent as a state machine. `P` is where a datagram comes from or goes to.
///
/// Call [`receive`](Self::receive) for every datagram that has arrived, then
/// [`pump`](Self::pump) until it returns false, and both again when a datagram arrives or
/// [`next_deadline`](Self::next_deadline) has come. Not thread-safe; one thread owns it.
#[derive(Debug)]
pub struct AgentCore<P> {
    pub(super) limits: Limits,
    pub(super) rules: Vec<TopicRule>,
    pub(super) profiles: Profiles,
    /// The clients that may log in.
    pub(super) access: Option<AccessList>,
    /// Distinguishes this agent from its predecessor.
    pub(super) instance: u16,
    /// Requesters so far.
    pub(super) requesters: u32,
    pub(super) clients: Clients<P>,
    pub(super) topics: Topics<Address>,
    /// Bytes of all samples, counted once each. The clients' accounts limit them.
    pub(super) pool: Ledger,
    pub(super) replies: Replies<P>,
    /// Requests that may come from outside of sessions.
    pub(super) unauthenticated: Option<Strangers<P>>,
    /// The host of a peer; `None` for peers without one, which share one.
    pub(super) host: fn(&P) -> Option<IpAddr>,
    /// The client that a peer's transport has shown it to be.
    pub(super) identity: fn(&P) -> Option<ClientKey>,
    /// Peers whose transport has shown that they receive.
    pub(super) connected: fn(&P) -> bool,
    /// Bytes of replies that the datagram being received may cause.
    pub(super) allowance: usize,
    /// The clients that may have something to send.
    pub(super) client_queue: ClientQueue,
    /// The times at which clients need attention at the latest.
    pub(super) timers: BTreeSet<(Nanos, usize)>,
    pub(super) blocked_streams: Vec<BlockedStream>,
    /// The clients that a sample was just routed to; kept for its memory.
    pub(super) served: Vec<usize>,
    /// The seam to another middleware.
    pub(super) bridge: Option<Bridge>,
    pub(super) refusals: Refusals,
    /// The streams on which messages were confirmed lately.
    pub(super) confirmed: ConfirmedStreams,
    /// The tracker of the message that is being received, once it has a reader to wait for.
    pub(super) tracker: Option<TrackerHandle>,
    pub(super) recovery_window: RecoveryWindow,
    /// Writers keep samples for returning readers.
    pub(super) stashed: bool,
    pub(super) log: Arc<RejectionLog<P>>,
    /// The pieces of recordings that boards send.
    pub(super) recordings: Arc<Recordings>,
    /// Rejections so far.
    pub(super) rejections: u64,
    /// The time of the last event.
    pub(super) time: Nanos,
    /// The same on the wall clock.
    pub(super) unix: i64,
    pub(super) counters: Arc<Counters>,
}

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// An agent without clients and without rules.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self::with(&AgentConfig {
            limits,
            ..AgentConfig::default()
        })
    }

    /// An agent without clients; addresses in `config` do not matter.
    #[must_use]
    pub fn with(config: &AgentConfig) -> Self {
        let limits = config.limits;
        Self {
            limits,
            rules: config.rules.clone(),
            profiles: config.profiles.clone(),
            access: config.access.clone(),
            instance: 0,
            requesters: 0,
            clients: Clients::new(limits.clients),
            topics: Topics::new(),
            pool: Ledger::new(usize::MAX),
            replies: Replies::new(),
            unauthenticated: Strangers::new(limits.unauthenticated_per_second),
            host: |_| None,
            identity: |_| None,
            connected: |_| false,
            allowance: 0,
            client_queue: ClientQueue::default(),
            timers: BTreeSet::new(),
            blocked_streams: Vec::new(),
            served: Vec::new(),
            bridge: None,
            refusals: Refusals::default(),
            confirmed: ConfirmedStreams::default(),
            tracker: None,
            recovery_window: RecoveryWindow::default(),
            stashed: false,
            log: Arc::new(RejectionLog::new()),
            recordings: Arc::default(),
            rejections: 0,
            time: 0,
            unix: 0,
            counters: Arc::default(),
        }
    }

    /// Tells peers of different hosts apart, so that one host cannot take the places and the rate
    /// of the others.
    #[must_use]
    pub fn hosts(self, host: fn(&P) -> Option<IpAddr>) -> Self {
        Self { host, ..self }
    }

    /// Tells which client a peer is, where its transport has shown it: it logs in as no other.
    #[must_use]
    pub fn identities(self, identity: fn(&P) -> Option<ClientKey>) -> Self {
        Self { identity, ..self }
    }

    /// Makes the identities of requests differ from those of agents with another `instance`, so
    /// that a reply that is late by an agent's life is not taken for another.
    #[must_use]
    pub fn instance(self, instance: u16) -> Self {
        Self { instance, ..self }
    }

    /// Takes in a datagram from `peer`.
    pub fn receive(&mut self, now: Now, peer: P, datagram: &[u8]) {
        (self.time, self.unix) = (now.monotonic, now.unix);
        self.counters.datagrams_in.hit();
        self.begin(now.monotonic);
        let Ok(message) = Message::parse(datagram) else {
            self.counters.malformed.hit();
            let bytes = datagram.len();
            self.note(peer, None, Reason::Malformed { bytes });
            return;
        };
        let header = message.header;
        let route = self.clients.by_route(peer, header.session);
        let client = route.and_then(|index| self.clients.get_mut(index));
        let (Some(index), Some(client)) = (route, client) else {
            self.earn(&peer, datagram.len(), None);
            if !header.session.is_none() {
                self.counters.no_session.hit();
                let session = header.session.0;
                self.note(peer, header.key, Reason::NoSession { session });
            } else if self.admit_unauthenticated(now.monotonic, peer) {
                self.outside(now, peer, &message);
            }
            return;
        };
        if header.key.is_some_and(|key| key != client.key) {
            self.counters.no_session.hit();
            self.note(peer, header.key, Reason::WrongKey);
            return;
        }
        client.counts.datagrams_in += 1;
        client.counts.bytes_in += datagram.len() as u64;
        if let Some(rate_limiter) = &mut client.rate_limiter
            && !rate_limiter.admit(now.monotonic, 1)
        {
            client.counts.rate_limited += 1;
            let key = client.key;
            self.counters.rate_limited.hit();
            let grant = client.grant.clone();
            let limit = self.limits_of(grant.as_ref()).datagrams_per_second;
            self.note(peer, Some(key), Reason::Rate { limit });
            return;
        }
        client.heard(now.monotonic, &self.limits);
        if !std::mem::replace(&mut client.arrived, true) {
            let origin = client.origin;
            self.recovery_window.arrived(now.monotonic, origin);
        }
        self.earn(&peer, datagram.len(), Some(index));
        if header.stream == StreamId::NONE {
            self.requests(now, index, StreamId::NONE, &message);
        } else if self.is_blocked(now.monotonic, index, header.stream, header.seq) {
            self.counters.held_back.hit();
        } else if let Some(input) = self
            .clients
            .get_mut(index)
            .and_then(|client| client.take_input(header.stream, &self.limits))
        {
            self.receive_on(now, index, input, &message);
        } else {
            self.counters.unsupported.hit();
            let limit = self.limits.streams;
            self.note_of(index, Reason::Streams { limit });
        }
        self.keep_allowance(index);
        self.serve(now.monotonic, index);
        self.confirm(now.monotonic);
    }

    fn admit_unauthenticated(&mut self, now: Nanos, peer: P) -> bool {
        let admitted = self
            .unauthenticated
            .as_mut()
            .is_none_or(|strangers| strangers.admit(now, peer, (self.host)(&peer)));
        if !admitted {
            self.counters.rate_limited.hit();
            let limit = self.limits.unauthenticated_per_second;
            self.note(peer, None, Reason::Unauthenticated { limit });
        }
        admitted
    }

    fn receive_on(
        &mut self,
        now: Now,
        index: usize,
        mut input: InputStream,
        message: &Message<'_>,
    ) {
        let stream = input.stream();
        let from = input.next();
        let seq = message.header.seq;
        let mut stopped = false;
        let received = input.receive(seq, message.body, |submessage| {
            let taken = self.take(now, index, stream, submessage);
            stopped |= !taken;
            taken
        });
        if stopped {
            self.counters.held_back.hit();
            input.postpone(input.next());
        }
        if received.is_err() {
            self.counters.malformed.hit();
            let bytes = message.body.len();
            self.note_of(index, Reason::Malformed { bytes });
        }
        self.put_back(now.monotonic, index, from, input);
    }

    /// A stream of the client in slot `index` need not wait any more.
    pub(super) fn resume(&mut self, at: Nanos, index: usize, stream: StreamId) {
        let client = self.clients.get_mut(index);
        let Some(mut input) = client.and_then(|c| c.take_input(stream, &self.limits)) else {
            return;
        };
        let now = Now {
            monotonic: at,
            unix: self.unix,
        };
        let from = input.next();
        let mut stopped = false;
        input.retry(|submessage| {
            let taken = self.take(now, index, stream, submessage);
            stopped |= !taken;
            taken
        });
        if !stopped {
            input.resume();
        }
        self.put_back(at, index, from, input);
    }

    /// Puts a stream back whose messages from `from` on were delivered just now.
    fn put_back(&mut self, now: Nanos, index: usize, from: SeqNum, mut input: InputStream) {
        if let Some(tracker) = self.tracker.take() {
            let until = self.confirmed_at(now, index);
            let late = input.withhold(from, &tracker, until);
            self.counters.confirmed_late.add(late);
        }
        if let Some(client) = self.clients.get_mut(index) {
            client.put_back(input);
        }
    }

    /// Handles all timers that are due at `now` and hands up to `max` datagrams to `send`, the most
    /// urgent first and to equals in turn. Returns whether there may be more to send.
    pub fn pump(&mut self, now: Now, max: usize, send: &mut dyn FnMut(&P, &[u8])) -> bool {
        self.begin(now.monotonic);
        (self.time, self.unix) = (now.monotonic, now.unix);
        self.attend(now.monotonic);
        self.confirm(now.monotonic);
        for _ in 0..max {
            if self.replies.send_one(send) {
                self.counters.datagrams_out.hit();
                continue;
            }
            let Some(index) = self.next_client() else {
                return false;
            };
            let Some(client) = self.clients.get_mut(index) else {
                continue;
            };
            let about = (&self.limits, self.recovery_window.companions(now.monotonic));
            if client.send_one(now.monotonic, about, &self.counters, send) {
                self.counters.datagrams_out.hit();
                self.serve(now.monotonic, index);
            } else {
                self.set_timer(now.monotonic, index);
            }
            self.unblock(now.monotonic);
            self.confirm(now.monotonic);
        }
        !(self.replies.is_empty() && self.client_queue.is_empty())
    }

    /// Holds peers until they are [released](Self::release): datagrams for them wait
    /// where its order can still change.
    pub fn hold(&mut self, which: impl Fn(&P) -> bool) {
        for index in self.clients.at(which) {
            if let Some(client) = self.clients.get_mut(index) {
                client.held = true;
            }
        }
    }

    /// Releases peers that take datagrams again.
    pub fn release(&mut self, now: Now, which: impl Fn(&P) -> bool) {
        for index in self.clients.at(which) {
            if let Some(client) = self.clients.get_mut(index) {
                client.held = false;
            }
            self.serve(now.monotonic, index);
        }
    }

    /// Whether a peer has a session.
    pub(crate) fn has_session(&self, which: impl Fn(&P) -> bool) -> bool {
        self.clients.iter().any(|client| which(&client.peer))
    }

    /// Ends the sessions of peers that are gone for good.
    pub fn gone(&mut self, which: impl Fn(&P) -> bool) {
        for index in self.clients.at(&which) {
            self.counters.clients_lost.hit();
            self.note_of(index, Reason::Disconnected);
            self.remove(index);
        }
        self.replies.forget(which);
    }

    /// The counters so far.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.counters.snapshot()
    }

    /// Sessions that were opened so far.
    pub(crate) fn sessions_opened(&self) -> u64 {
        self.counters.clients_created.get()
    }

    /// The log of rejections.
    pub(crate) fn log(&self) -> &Arc<RejectionLog<P>> {
        &self.log
    }

    /// The samples of boards' recordings.
    pub(crate) fn recordings(&self) -> &Arc<Recordings> {
        &self.recordings
    }

    pub(crate) fn counters(&self) -> &Arc<Counters> {
        &self.counters
    }

    /// Ends a session.
    pub(super) fn remove(&mut self, index: usize) {
        let Some(mut client) = self.clients.remove(index) else {
            return;
        };
        let left = client.entities.iter();
        let left = left.filter_map(|(_, record)| record.reader.as_deref());
        let left = left.map(|reader| reader.queued() as u64).sum();
        self.counters.samples_orphaned.add(left);
        let ids: Vec<_> = client.entities.iter().map(|(id, _)| id).collect();
        let served = ids.iter().filter_map(|id| client.entities.answers(*id));
        let served: Vec<_> = served.collect();
        client.entities.clear(&mut self.topics);
        served.iter().for_each(|topic| self.notify_served(*topic));
        if let Some(bridge) = &mut self.bridge {
            bridge.removed(index);
        }
        if let Some(level) = client.queued {
            self.client_queue.leave(level, index);
        }
        if let Some(at) = client.timer {
            self.timers.remove(&(at, index));
        }
        self.blocked_streams
            .retain(|blocked| blocked.client != index);
        self.counters.clients.set(self.clients.len());
        self.count_companions();
    }
}
