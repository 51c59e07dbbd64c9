//! One client: its session, its entities, its streams.

use crate::config::Limits;
use crate::entities::Entities;
use crate::inlet::Inlet;
use crate::outlet::Outlet;
use crate::stats::Counters;
use crate::topics::Topics;
use replenish_xrce::stream::StreamHeader;
use replenish_xrce::wire::{
    AckNack, ClientKey, Encode, Header, Heartbeat, MessageWriter, ObjectId, SessionId, StatusReply,
    StreamId,
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
    pub(crate) entities: Entities,
    /// It stands in the agent's line of clients to be served.
    pub(crate) queued: bool,
    heard: Nanos,
    probe_at: Nanos,
    inlets: Vec<Inlet>,
    outlets: Vec<Outlet>,
    /// The outlet whose turn it is.
    turn: usize,
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
            entities: Entities::new(index),
            queued: false,
            heard: now,
            probe_at: now.saturating_add(limits.silence / 3),
            inlets: Vec::new(),
            outlets: Vec::new(),
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

    /// Takes a stream out to work with it, new if need be; `None` above the limit.
    /// [`put_back`](Self::put_back) it.
    pub(crate) fn take_inlet(&mut self, stream: StreamId, limits: &Limits) -> Option<Inlet> {
        match self
            .inlets
            .iter()
            .position(|inlet| inlet.stream() == stream)
        {
            Some(at) => Some(self.inlets.swap_remove(at)),
            None if self.inlets.len() < limits.streams => {
                Some(Inlet::new(stream, self.mtu, limits))
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
        let at = match self
            .outlets
            .iter()
            .position(|outlet| outlet.stream() == stream)
        {
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
                self.outlets.push(Outlet::new(header, self.mtu, limits));
                self.outlets.len() - 1
            }
        };
        self.outlets.get_mut(at)
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

    /// Gives `reader` its turn on the stream it has something to say on.
    pub(crate) fn queue(&mut self, reader: ObjectId) {
        let Some(stream) = self
            .entities
            .reader(reader)
            .and_then(|reader| reader.ready())
        else {
            return;
        };
        if let Some(outlet) = self
            .outlets
            .iter_mut()
            .find(|outlet| outlet.stream() == stream)
        {
            outlet.queue(reader);
        }
    }

    /// Takes the turns of deleted entities away.
    pub(crate) fn forget(&mut self, deleted: &[ObjectId]) {
        for outlet in &mut self.outlets {
            deleted.iter().for_each(|id| outlet.forget(*id));
        }
    }

    /// An ACKNACK.
    pub(crate) fn acknowledge(&mut self, now: Nanos, acknack: &AckNack) {
        let stream = acknack.stream;
        if let Some(outlet) = self
            .outlets
            .iter_mut()
            .find(|outlet| outlet.stream() == stream)
        {
            outlet.acknowledge(now, acknack);
        }
    }

    /// When it next needs attention without having sent anything.
    pub(crate) fn deadline(&self, limits: &Limits) -> Nanos {
        let heartbeat = self.outlets.iter().filter_map(Outlet::deadline).min();
        let alive = self.dies_at(limits).min(self.probe_at);
        heartbeat.map_or(alive, |heartbeat| heartbeat.min(alive))
    }

    /// Hands the next datagram for this client to `send`; returns whether there was one.
    pub(crate) fn send_one(
        &mut self,
        now: Nanos,
        limits: &Limits,
        counters: &Counters,
        send: &mut dyn FnMut(&P, &[u8]),
    ) -> bool {
        let Self {
            peer,
            inlets,
            outlets,
            entities,
            ..
        } = self;
        if let Some(ack) = inlets.iter_mut().find_map(Inlet::take_ack) {
            return self.control(&ack, send);
        }
        if let Some(heartbeat) = outlets.iter_mut().find_map(|o| o.take_heartbeat(now)) {
            return self.control(&heartbeat, send);
        }
        for _ in 0..outlets.len() {
            let turn = self.turn % outlets.len();
            self.turn = turn + 1;
            if let Some(outlet) = outlets.get_mut(turn)
                && outlet.send_one(now, entities, counters, &mut |bytes| send(peer, bytes))
            {
                return true;
            }
        }
        match self.probe(now, limits) {
            Some(probe) => self.control(&probe, send),
            None => false,
        }
    }

    /// Asks a client that has long been silent for a sign of life: every receiver answers a
    /// HEARTBEAT, also one about nothing.
    fn probe(&mut self, now: Nanos, limits: &Limits) -> Option<Heartbeat> {
        if now < self.probe_at {
            return None;
        }
        self.probe_at = now.saturating_add(limits.silence / 3);
        self.outlets.iter().find_map(Outlet::probe)
    }

    /// Sends a message outside of streams.
    fn control(&self, body: &impl Encode, send: &mut dyn FnMut(&P, &[u8])) -> bool {
        let header = Header::new(self.session, StreamId::NONE, SeqNum(0), self.key);
        let mut buf = [0; LONGEST_CONTROL];
        let message = MessageWriter::new(&mut buf, &header).and_then(|mut message| {
            message.push(body)?;
            Ok(message.finish())
        });
        message.map(|bytes| send(&self.peer, bytes)).is_ok()
    }

    /// Detaches all entities from their topics, at the end of the session.
    pub(crate) fn close(&mut self, topics: &mut Topics<crate::entities::ReaderAddress>) {
        self.entities.clear(topics);
    }
}
