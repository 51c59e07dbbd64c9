//! One client: its session, its entities, its streams.

use super::input_stream::Inlet;
use super::output_stream::{Outlet, TOP, Throttled};
use crate::config::Limits;
use crate::entities::{Entities, Readiness};
use crate::flow::{Ledger, Pace};
use crate::report::Counters;
use replenish_xrce::stream::StreamHeader;
use replenish_xrce::wire::{
    AckNack, ClientKey, Encode, Header, Heartbeat, MessageWriter, Notice, ObjectId, SessionId,
    StatusReply, StreamId,
};
use replenish_xrce::{Nanos, SeqNum};

/// Bytes of the longest message outside of streams that a client is sent: HEARTBEAT with key.
const LONGEST_CONTROL: usize = 32;

/// A client with an open session.
#[derive(Debug)]
pub(crate) struct Client<P> {
    pub(crate) peer: P,
    pub(crate) key: ClientKey,
    pub(crate) session: SessionId,
    /// The longest message it is sent.
    pub(crate) mtu: usize,
    pub(crate) created: Nanos,
    /// The session of this client that this one replaced.
    pub(crate) before: Option<SessionId>,
    pub(crate) delivery: Option<Promise>,
    /// It has sent something in a session: it knows that it has one.
    pub(crate) arrived: bool,
    pub(crate) entities: Entities,
    /// What it makes the agent keep.
    pub(crate) ledger: Ledger,
    /// Datagrams it may send.
    pub(crate) pace: Option<Pace>,
    /// It stands in the agent's line of clients to be served, at this level.
    pub(crate) queued: Option<u8>,
    /// It is in the agent's agenda for this time.
    pub(crate) appointment: Option<Nanos>,
    /// Its transport takes nothing now.
    pub(crate) held: bool,
    pub(crate) counts: ClientCounts,
    pub(crate) heard: Nanos,
    probe_at: Nanos,
    inlets: Vec<Inlet>,
    outlets: Vec<Outlet>,
    throttled: Throttled,
    /// The outlet whose turn it is among equals.
    turn: usize,
}

/// What a client that asks for [`DELIVERY`](replenish_xrce::wire::DELIVERY) has said about itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Promise {
    /// It has just begun.
    New,
    /// It had a session before, with an agent that was lost; so many clients had, itself included,
    /// if it knows.
    Back(u8),
}

/// What is counted for each client.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ClientCounts {
    pub(crate) datagrams_in: u64,
    pub(crate) datagrams_out: u64,
    pub(crate) bytes_in: u64,
    pub(crate) bytes_out: u64,
    pub(crate) rate_limited: u64,
}

impl<P> Client<P> {
    /// A client that has just opened its session, in slot `index` of the agent.
    pub(crate) fn new(
        index: usize,
        peer: P,
        (key, session): (ClientKey, SessionId),
        mtu: usize,
        now: Nanos,
        limits: &Limits,
    ) -> Self {
        Self {
            peer,
            key,
            session,
            mtu,
            created: now,
            before: None,
            delivery: None,
            arrived: false,
            entities: Entities::new(index),
            ledger: Ledger::new(limits.client_bytes),
            pace: Pace::new(limits.datagrams_per_second),
            queued: None,
            appointment: None,
            held: false,
            counts: ClientCounts::default(),
            heard: now,
            probe_at: now.saturating_add(limits.silence / 3),
            inlets: Vec::new(),
            outlets: Vec::new(),
            throttled: Vec::new(),
            turn: 0,
        }
    }

    /// It has sent something.
    pub(crate) fn heard(&mut self, now: Nanos, limits: &Limits) {
        self.heard = now;
        self.probe_at = now.saturating_add(limits.silence / 3);
    }

    /// When it is to be forgotten if it stays silent.
    pub(crate) fn dies_at(&self, limits: &Limits) -> Nanos {
        self.heard.saturating_add(limits.silence)
    }

    /// A stream from the client.
    pub(crate) fn inlet(&mut self, stream: StreamId) -> Option<&mut Inlet> {
        self.inlets.iter_mut().find(|i| i.stream() == stream)
    }

    /// Takes a stream out to work with it, new if need be; `None` above the limit.
    /// [`put_back`](Self::put_back) it.
    pub(crate) fn take_inlet(&mut self, stream: StreamId, limits: &Limits) -> Option<Inlet> {
        match self.inlets.iter().position(|i| i.stream() == stream) {
            Some(at) => Some(self.inlets.swap_remove(at)),
            None if self.inlets.len() < limits.streams => {
                let both = self.delivery.is_some();
                Inlet::new(stream, self.mtu, both, limits, &self.ledger)
            }
            None => None,
        }
    }

    /// Puts back what [`take_inlet`](Self::take_inlet) took out.
    pub(crate) fn put_back(&mut self, inlet: Inlet) {
        self.inlets.push(inlet);
    }

    /// A stream to the client, new if need be; `None` above the limit or for "no stream".
    pub(crate) fn outlet(&mut self, stream: StreamId, limits: &Limits) -> Option<&mut Outlet> {
        let at = match self.outlets.iter().position(|o| o.stream() == stream) {
            Some(at) => at,
            None if stream == StreamId::NONE || self.outlets.len() >= limits.streams => {
                return None;
            }
            None => {
                let header = StreamHeader {
                    session: self.session,
                    stream,
                    key: self.key,
                };
                let outlet = Outlet::new(header, self.mtu, limits, &self.ledger)?;
                self.outlets.push(outlet);
                self.outlets.len() - 1
            }
        };
        self.outlets.get_mut(at)
    }

    /// The streams to the client.
    pub(crate) fn outlets(&self) -> &[Outlet] {
        &self.outlets
    }

    /// Queues the answer to a request that came on `stream`; returns whether there was room.
    pub(crate) fn status(
        &mut self,
        stream: StreamId,
        status: StatusReply,
        limits: &Limits,
    ) -> bool {
        self.outlet(stream, limits)
            .is_some_and(|outlet| outlet.status(status))
    }

    /// Queues what the client is told unasked, if it is one that understands it.
    pub(crate) fn notice(&mut self, object: ObjectId, notice: Notice, limits: &Limits) {
        if self.delivery.is_some()
            && let Some(outlet) = self.outlet(StreamId::RELIABLE, limits)
        {
            outlet.notice(object, notice);
        }
    }

    /// Gives `reader` its turn on the stream it has something to say on, now or later.
    pub(crate) fn queue(&mut self, reader: ObjectId, now: Nanos, counters: &Counters) {
        let Some(endpoint) = self.entities.reader(reader) else {
            return;
        };
        match endpoint.readiness(now, counters) {
            Readiness::Idle => {}
            Readiness::Now(stream) => {
                let service = endpoint.service;
                let outlet = self.outlets.iter_mut().find(|o| o.stream() == stream);
                if let Some(outlet) = outlet {
                    outlet.queue(reader, service);
                }
            }
            Readiness::At(at) => {
                self.throttled.retain(|(_, id)| *id != reader);
                self.throttled.push((at, reader));
            }
        }
    }

    /// Whether what is written for `reader` now must reach this client before it counts as settled.
    pub(crate) fn is_awaited(&mut self, reader: ObjectId, now: Nanos, patience: Nanos) -> bool {
        let Some(endpoint) = self.entities.reader(reader) else {
            return false;
        };
        let stream = endpoint.stream();
        // One that has got all it asked for is waited for if its client is known to ask for more.
        if stream.is_none() && self.delivery.is_none() {
            return false;
        }
        let lags = |outlet: &Outlet| Some(outlet.stream()) == stream && outlet.lags(now, patience);
        endpoint.is_awaited(now, patience) && !self.outlets.iter().any(lags)
    }

    /// Notes what of the client's messages is settled by now.
    pub(crate) fn settle(&mut self, now: Nanos, counters: &Counters) {
        for inlet in &mut self.inlets {
            counters.settled_late.add(inlet.settle(now));
        }
    }

    /// Gives those their turns whose waiting time is over.
    pub(crate) fn wake(&mut self, now: Nanos, counters: &Counters) {
        self.settle(now, counters);
        while let Some(due) = self.throttled.iter().position(|(at, _)| *at <= now) {
            let (_, reader) = self.throttled.swap_remove(due);
            self.queue(reader, now, counters);
        }
    }

    /// Takes the turns of a deleted entity away.
    pub(crate) fn forget(&mut self, deleted: ObjectId) {
        self.throttled.retain(|(_, id)| *id != deleted);
        for outlet in &mut self.outlets {
            outlet.forget(deleted);
        }
    }

    /// An ACKNACK.
    pub(crate) fn acknowledge(&mut self, now: Nanos, acknack: &AckNack) {
        let stream = acknack.stream;
        if let Some(outlet) = self.outlets.iter_mut().find(|o| o.stream() == stream) {
            outlet.acknowledge(now, acknack);
        }
    }

    /// When it next needs attention without having sent anything.
    pub(crate) fn deadline(&self, limits: &Limits) -> Nanos {
        let dies = self.dies_at(limits);
        if self.held {
            return dies;
        }
        let heartbeats = self.outlets.iter().filter_map(Outlet::deadline);
        let throttled = self.throttled.iter().map(|(at, _)| *at);
        let unsettled = self.inlets.iter().filter_map(Inlet::deadline);
        let timers = heartbeats.chain(throttled).chain(unsettled);
        let first = timers.chain([self.probe_at]).min();
        first.map_or(dies, |first| first.min(dies))
    }

    /// How urgent what it can be sent now is; `None` if there is nothing.
    pub(crate) fn urgency(&self, now: Nanos) -> Option<u8> {
        if self.held {
            return None;
        }
        let heartbeat = |outlet: &Outlet| outlet.deadline().is_some_and(|at| at <= now);
        let control = self.inlets.iter().any(Inlet::ack_due)
            || self.outlets.iter().any(heartbeat)
            || self.probe_at <= now;
        if control {
            return Some(TOP);
        }
        self.outlets.iter().filter_map(|o| o.urgency(now)).max()
    }

    /// Hands the next datagram for this client to `send`; returns whether there was one.
    pub(crate) fn send_one(
        &mut self,
        now: Nanos,
        (limits, companions): (&Limits, u8),
        counters: &Counters,
        send: &mut dyn FnMut(&P, &[u8]),
    ) -> bool {
        let Self {
            peer,
            inlets,
            outlets,
            entities,
            throttled,
            counts,
            ..
        } = self;
        let mut send = |bytes: &[u8]| {
            counts.datagrams_out += 1;
            counts.bytes_out += bytes.len() as u64;
            send(peer, bytes);
        };
        let header = Header::new(self.session, StreamId::NONE, SeqNum(0), self.key);
        if let Some(ack) = inlets.iter_mut().find_map(|i| i.take_ack(companions)) {
            return control(&header, &ack, &mut send);
        }
        if let Some(heartbeat) = outlets.iter_mut().find_map(|o| o.take_heartbeat(now)) {
            return control(&header, &heartbeat, &mut send);
        }
        // The most urgent outlet; among equals the one after the last that had its turn.
        let count = outlets.len();
        let mut tried = 0_u32;
        for _ in 0..count {
            let order = (0..count).map(|i| (self.turn + i) % count);
            let untried = order.filter(|at| tried & (1 << at) == 0);
            let level = |at: usize| outlets.get(at).and_then(|o| o.urgency(now));
            let Some((at, _)) = untried
                .filter_map(|at| Some((at, level(at)?)))
                .reduce(|best, next| if next.1 > best.1 { next } else { best })
            else {
                break;
            };
            tried |= 1 << at;
            if let Some(outlet) = outlets.get_mut(at)
                && outlet.send_one(now, entities, throttled, counters, &mut send)
            {
                self.turn = at + 1;
                return true;
            }
        }
        if now < self.probe_at {
            return false;
        }
        // Asks for a sign of life: every receiver answers a HEARTBEAT, also one about nothing.
        self.probe_at = now.saturating_add(limits.silence / 3);
        let probe: Option<Heartbeat> = outlets.iter().find_map(Outlet::probe);
        probe.is_some_and(|probe| control(&header, &probe, &mut send))
    }
}

/// Sends a message outside of streams.
fn control(header: &Header, body: &impl Encode, send: &mut dyn FnMut(&[u8])) -> bool {
    let mut buf = [0; LONGEST_CONTROL];
    let message = MessageWriter::new(&mut buf, header).and_then(|mut message| {
        message.push(body)?;
        Ok(message.finish())
    });
    message.map(send).is_ok()
}
