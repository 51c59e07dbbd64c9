//! One client: its session, its entities, its streams.

use super::echo::Echo;
use super::input_stream::InputStream;
use super::output_stream::{OutputStream, TOP, Throttled, throttle};
use crate::config::{Grant, Limits};
use crate::entities::{Entities, QUEUE_OVERHEAD, Readiness};
use crate::flow::{Ledger, RateLimiter};
use crate::report::Counters;
use replenish_xrce::stream::StreamHeader;
use replenish_xrce::wire::{
    AckNack, ClientKey, Encode, Header, Heartbeat, MessageWriter, Notice, ObjectId, SessionId,
    StatusReply, StreamId,
};
use replenish_xrce::{Nanos, SeqNum};
use std::sync::Arc;

/// Bytes of the longest message outside of streams that a client is sent: HEARTBEAT with key.
const LONGEST_CONTROL: usize = 32;

/// The time between two HEARTBEATs to a client that must show that it lives, and how many it gets.
const CHALLENGE_AGAIN: Nanos = 250_000_000;
const CHALLENGES: u8 = 3;

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
    pub(crate) origin: Option<ClientOrigin>,
    /// Its rights, if there is an access list.
    pub(crate) grant: Option<Arc<Grant>>,
    /// The client has sent a message in a session: it knows that it has one.
    pub(crate) arrived: bool,
    pub(crate) entities: Entities,
    /// The account of the memory that it takes.
    pub(crate) ledger: Ledger,
    /// Datagrams it may send.
    pub(crate) rate_limiter: Option<RateLimiter>,
    /// Its level in the agent's client queue.
    pub(crate) queued: Option<u8>,
    /// Its time in the agent's timers.
    pub(crate) timer: Option<Nanos>,
    /// The client's transport is full.
    pub(crate) held: bool,
    pub(crate) counts: ClientCounts,
    pub(crate) heard: Nanos,
    /// Whether its address has shown that it receives.
    pub(crate) echo: Echo,
    /// Since when it must show that it lives, because its key logs in elsewhere.
    pub(crate) challenged: Option<Nanos>,
    /// HEARTBEATs that follow soon because of that.
    challenges: u8,
    probe_at: Nanos,
    inputs: Vec<InputStream>,
    outputs: Vec<OutputStream>,
    throttled: Throttled,
    /// The output stream that is next among equals.
    next_output: usize,
}

/// The origin that a client states when it asks for [`DELIVERY`](replenish_xrce::wire::DELIVERY).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ClientOrigin {
    /// A client without samples from before.
    New,
    /// A client of an agent that was lost, with the number of clients that agent had, this one
    /// included; 0 if it does not know.
    Returned(u8),
}

/// The counters of a client.
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
            origin: None,
            grant: None,
            arrived: false,
            entities: Entities::new(index),
            ledger: Ledger::new(limits.client_bytes),
            rate_limiter: RateLimiter::new(limits.datagrams_per_second),
            queued: None,
            timer: None,
            held: false,
            counts: ClientCounts::default(),
            heard: now,
            echo: Echo::Shown,
            challenged: None,
            challenges: 0,
            probe_at: now.saturating_add(limits.silence / 3),
            inputs: Vec::new(),
            outputs: Vec::new(),
            throttled: Vec::new(),
            next_output: 0,
        }
    }

    /// Whether it may keep another sample of `bytes`.
    pub(crate) fn has_memory(&self, bytes: usize) -> bool {
        self.ledger.free() >= bytes.saturating_add(QUEUE_OVERHEAD)
    }

    /// Notes that the client has sent something.
    pub(crate) fn heard(&mut self, now: Nanos, limits: &Limits) {
        self.heard = now;
        self.challenges = 0;
        self.probe_at = now.saturating_add(limits.silence / 3);
    }

    /// Makes the client show that it lives.
    pub(crate) fn challenge(&mut self, now: Nanos) {
        self.challenged = Some(now);
        self.challenges = CHALLENGES;
        self.probe_at = now;
    }

    /// Since when it must show that it lives, and whether it has. `None` until that is known.
    pub(crate) fn challenge_met(&self, now: Nanos) -> Option<bool> {
        let since = self.challenged?;
        let lives = self.heard > since;
        let over = now.saturating_sub(since) >= CHALLENGE_AGAIN * Nanos::from(CHALLENGES);
        (lives || over).then_some(lives)
    }

    /// Time at which it is forgotten if it stays silent.
    pub(crate) fn dies_at(&self, limits: &Limits) -> Nanos {
        self.heard.saturating_add(limits.silence)
    }

    /// A stream from the client.
    pub(crate) fn input(&mut self, stream: StreamId) -> Option<&mut InputStream> {
        self.inputs.iter_mut().find(|i| i.stream() == stream)
    }

    /// Takes a stream out to work with it, new if need be; `None` above the limit.
    /// [`put_back`](Self::put_back) it.
    pub(crate) fn take_input(&mut self, stream: StreamId, limits: &Limits) -> Option<InputStream> {
        match self.inputs.iter().position(|i| i.stream() == stream) {
            Some(at) => Some(self.inputs.swap_remove(at)),
            None if self.inputs.len() < limits.streams => {
                let both = self.origin.is_some();
                InputStream::new(stream, self.mtu, both, limits, &self.ledger)
            }
            None => None,
        }
    }

    /// Puts back what [`take_input`](Self::take_input) took out.
    pub(crate) fn put_back(&mut self, input: InputStream) {
        self.inputs.push(input);
    }

    /// A stream to the client, new if need be; `None` above the limit or for "no stream".
    pub(crate) fn output(
        &mut self,
        stream: StreamId,
        limits: &Limits,
    ) -> Option<&mut OutputStream> {
        let at = match self.outputs.iter().position(|o| o.stream() == stream) {
            Some(at) => at,
            None if stream == StreamId::NONE || self.outputs.len() >= limits.streams => {
                return None;
            }
            None => {
                let header = StreamHeader {
                    session: self.session,
                    stream,
                    key: self.key,
                };
                let output = OutputStream::new(header, self.mtu, limits, &self.ledger)?;
                self.outputs.push(output);
                self.outputs.len() - 1
            }
        };
        self.outputs.get_mut(at)
    }

    /// The streams to the client.
    pub(crate) fn outputs(&self) -> &[OutputStream] {
        &self.outputs
    }

    /// Queues the answer to a request that came on `stream`; returns whether there was room.
    pub(crate) fn status(
        &mut self,
        stream: StreamId,
        status: StatusReply,
        limits: &Limits,
    ) -> bool {
        self.output(stream, limits)
            .is_some_and(|output| output.status(status))
    }

    /// Queues a notice, if the client understands it.
    pub(crate) fn notice(&mut self, object: ObjectId, notice: Notice, limits: &Limits) {
        if self.origin.is_some()
            && let Some(output) = self.output(StreamId::RELIABLE, limits)
        {
            output.notice(object, notice);
        }
    }

    /// Gives `reader` a turn on the stream that it has a sample for, now or later.
    pub(crate) fn queue(&mut self, reader: ObjectId, now: Nanos, counters: &Counters) {
        let Some(endpoint) = self.entities.reader(reader) else {
            return;
        };
        match endpoint.readiness(now, counters) {
            Readiness::Idle => {}
            Readiness::Now(stream) => {
                let service = endpoint.service;
                let output = self.outputs.iter_mut().find(|o| o.stream() == stream);
                if let Some(output) = output {
                    output.queue(reader, service);
                }
            }
            Readiness::At(at) => {
                throttle(&mut self.throttled, at, reader);
            }
        }
    }

    /// Whether a sample for `reader` must reach this client before it counts as confirmed.
    pub(crate) fn is_awaited(&mut self, reader: ObjectId, now: Nanos, limit: Nanos) -> bool {
        let Some(endpoint) = self.entities.reader(reader) else {
            return false;
        };
        let stream = endpoint.stream();
        // A reader that has got all it asked for is waited for if its client is known to ask for
        // more.
        if stream.is_none() && self.origin.is_none() {
            return false;
        }
        let lags =
            |output: &OutputStream| Some(output.stream()) == stream && output.lags(now, limit);
        endpoint.is_awaited(now, limit) && !self.outputs.iter().any(lags)
    }

    /// Removes the client's confirmed messages.
    pub(crate) fn confirm(&mut self, now: Nanos, counters: &Counters) {
        for input in &mut self.inputs {
            counters.confirmed_late.add(input.confirm(now));
        }
    }

    /// Gives a turn to the readers whose waiting time is over.
    pub(crate) fn wake(&mut self, now: Nanos, counters: &Counters) {
        self.confirm(now, counters);
        while let Some(due) = self.throttled.iter().position(|(at, _)| *at <= now) {
            let (_, reader) = self.throttled.swap_remove(due);
            self.queue(reader, now, counters);
        }
    }

    /// Removes a deleted entity from all streams.
    pub(crate) fn forget(&mut self, deleted: ObjectId) {
        self.throttled.retain(|(_, id)| *id != deleted);
        for output in &mut self.outputs {
            output.forget(deleted);
        }
    }

    /// An ACKNACK.
    pub(crate) fn acknowledge(&mut self, now: Nanos, acknack: &AckNack) {
        let stream = acknack.stream;
        let output = self.outputs.iter_mut().find(|o| o.stream() == stream);
        let progress = output.is_some_and(|output| output.acknowledge(now, acknack));
        self.echo.answered(progress);
    }

    /// Time to ask for an echo: samples wait for it.
    fn echo_at(&self) -> Option<Nanos> {
        let waits = self.outputs.iter().any(OutputStream::has_samples);
        self.echo.ask_at().filter(|_| waits)
    }

    /// Time at which it next needs attention without having sent anything.
    pub(crate) fn deadline(&self, limits: &Limits) -> Nanos {
        let dies = self.dies_at(limits);
        if self.held || !self.echo.admits(LONGEST_CONTROL) {
            return dies;
        }
        let heartbeats = self.outputs.iter().filter_map(OutputStream::deadline);
        let throttled = self.throttled.iter().map(|(at, _)| *at);
        let unconfirmed = self.inputs.iter().filter_map(InputStream::deadline);
        let timers = heartbeats.chain(throttled).chain(unconfirmed);
        let first = timers.chain([self.probe_at]).chain(self.echo_at()).min();
        first.map_or(dies, |first| first.min(dies))
    }

    /// The urgency of the next datagram; `None` if there is none now.
    pub(crate) fn urgency(&self, now: Nanos) -> Option<u8> {
        if self.held || !self.echo.admits(LONGEST_CONTROL) {
            return None;
        }
        let heartbeat = |output: &OutputStream| output.deadline().is_some_and(|at| at <= now);
        let control = self.inputs.iter().any(InputStream::ack_due)
            || self.outputs.iter().any(heartbeat)
            || self.probe_at <= now
            || self.echo_at().is_some_and(|at| at <= now);
        if control {
            return Some(TOP);
        }
        let samples = self.echo.is_shown();
        let levels = self.outputs.iter().filter_map(|o| o.urgency(now, samples));
        levels.max()
    }

    /// Hands the next datagram for this client to `send`; returns whether there was one.
    pub(crate) fn send_one(
        &mut self,
        now: Nanos,
        (limits, companions): (&Limits, u8),
        counters: &Counters,
        send: &mut dyn FnMut(&P, &[u8]),
    ) -> bool {
        if !self.echo.admits(LONGEST_CONTROL) {
            return false;
        }
        let asks_echo = self.echo_at().is_some_and(|at| at <= now);
        let samples = self.echo.is_shown();
        let Self {
            peer,
            inputs,
            outputs,
            entities,
            throttled,
            counts,
            echo,
            ..
        } = self;
        let mut send = |bytes: &[u8]| {
            counts.datagrams_out += 1;
            counts.bytes_out += bytes.len() as u64;
            echo.spend(bytes.len());
            send(peer, bytes);
        };
        let header = Header::new(self.session, StreamId::NONE, SeqNum(0), self.key);
        if let Some(ack) = inputs.iter_mut().find_map(|i| i.take_ack(companions)) {
            return control(&header, &ack, &mut send);
        }
        if let Some(heartbeat) = outputs.iter_mut().find_map(|o| o.take_heartbeat(now)) {
            return control(&header, &heartbeat, &mut send);
        }
        // The most urgent output; among equals the one after the last that had its turn.
        let count = outputs.len();
        let mut tried = 0_u32;
        for _ in 0..count {
            let order = (0..count).map(|i| (self.next_output + i) % count);
            let untried = order.filter(|at| tried & (1 << at) == 0);
            let level = |at: usize| outputs.get(at).and_then(|o| o.urgency(now, samples));
            let Some((at, _)) = untried
                .filter_map(|at| Some((at, level(at)?)))
                .reduce(|best, next| if next.1 > best.1 { next } else { best })
            else {
                break;
            };
            tried |= 1 << at;
            if let Some(output) = outputs.get_mut(at)
                && output.send_one(
                    now,
                    samples,
                    (&mut *entities, &mut *throttled),
                    counters,
                    &mut send,
                )
            {
                self.next_output = at + 1;
                return true;
            }
        }
        // Asks for a sign of life: every receiver answers a HEARTBEAT, also one about nothing.
        let urgent = asks_echo || self.challenges > 0;
        let silent = now >= self.probe_at;
        if !silent && !asks_echo {
            return false;
        }
        if silent {
            let soon = self.challenges.checked_sub(1);
            self.challenges = soon.unwrap_or(0);
            let pause = soon.map_or(limits.silence / 3, |_| CHALLENGE_AGAIN);
            self.probe_at = now.saturating_add(pause);
        }
        let probe = outputs.iter().find_map(|output| output.probe(urgent));
        let probe = probe.or_else(|| urgent.then_some(ABOUT_NOTHING));
        let sent = probe.is_some_and(|probe| control(&header, &probe, &mut send));
        if asks_echo {
            self.echo.ask(now);
        }
        sent
    }
}

/// A HEARTBEAT of the stream that every stock client has, before anything was sent on it.
const ABOUT_NOTHING: Heartbeat = Heartbeat {
    first: SeqNum(0),
    last: SeqNum(u16::MAX),
    stream: StreamId::RELIABLE,
};

/// Sends a message outside of streams.
fn control(header: &Header, body: &impl Encode, send: &mut dyn FnMut(&[u8])) -> bool {
    let mut buf = [0; LONGEST_CONTROL];
    let message = MessageWriter::new(&mut buf, header).and_then(|mut message| {
        message.push(body)?;
        Ok(message.finish())
    });
    message.map(send).is_ok()
}
