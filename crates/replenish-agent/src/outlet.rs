//! One stream from the agent to a client, with everyone who wants to send on it.
//!
//! ```text
//!   statuses ──────────────┐ first
//!   reader ─┐              ▼
//!   reader ─┼─► turns ──► stream ──► datagrams
//!   reader ─┘  one sample at a time
//! ```
//!
//! Samples stay in their readers' queues, where keep-last applies, until the stream can really
//! send them: nothing is queued twice, and a reader with a backlog takes turns with the others
//! instead of standing before them.
//!
//! Each datagram carries one submessage, as those of eProsima's agents do: their client skips what
//! is packed behind a service reply.

use crate::config::Limits;
use crate::entities::Entities;
use crate::stats::Counters;
use replenish_xrce::stream::{
    OutputBestEffort, OutputReliable, PushError, Reliability, StreamHeader, Tail,
};
use replenish_xrce::wire::{AckNack, Data, Encode, Heartbeat, ObjectId, StatusReply, StreamId};
use replenish_xrce::{Nanos, SeqNum};
use std::collections::VecDeque;

/// Unacknowledged messages: what the client's ACKNACK can name.
const IN_FLIGHT: u16 = 16;

/// Messages that a reliable stream can hold: a sample in fragments besides those in flight.
const SLOTS: usize = 256;

/// Statuses that may wait.
const MAX_STATUSES: usize = 64;

/// A stream's sending end.
#[derive(Debug)]
pub(crate) struct Outlet {
    machine: Machine,
    statuses: VecDeque<StatusReply>,
    /// Readers with samples for this stream, each once.
    turns: VecDeque<ObjectId>,
}

#[derive(Debug)]
enum Machine {
    BestEffort(OutputBestEffort<Box<[u8]>>),
    Reliable {
        machine: Box<OutputReliable<Box<[u8]>, SLOTS>>,
        capacity: usize,
    },
}

impl Outlet {
    /// A stream at its beginning, for a client that takes messages of up to `mtu` bytes.
    pub(crate) fn new(header: StreamHeader, mtu: usize, limits: &Limits) -> Self {
        let machine = if header.stream.is_reliable() {
            let config = Reliability {
                in_flight: IN_FLIGHT,
                ..Reliability::default()
            };
            let piece = mtu.saturating_sub(header.len() + 4).max(1);
            let slots = limits.longest_submessage().div_ceil(piece) + usize::from(IN_FLIGHT);
            let ring = vec![0; slots.min(SLOTS) * mtu].into_boxed_slice();
            let machine = Box::new(OutputReliable::new(ring, mtu, header, Tail::Exact, config));
            let capacity = machine.free();
            Machine::Reliable { machine, capacity }
        } else {
            let buf = vec![0; mtu].into_boxed_slice();
            Machine::BestEffort(OutputBestEffort::new(buf, header, Tail::Exact))
        };
        Self {
            machine,
            statuses: VecDeque::new(),
            turns: VecDeque::new(),
        }
    }

    pub(crate) fn stream(&self) -> StreamId {
        match &self.machine {
            Machine::BestEffort(machine) => machine.header().stream,
            Machine::Reliable { machine, .. } => machine.header().stream,
        }
    }

    /// Queues a status; returns whether there was room.
    pub(crate) fn status(&mut self, status: StatusReply) -> bool {
        let room = self.statuses.len() < MAX_STATUSES;
        if room {
            self.statuses.push_back(status);
        }
        room
    }

    /// Gives `reader` a turn, because it has a sample for this stream.
    pub(crate) fn queue(&mut self, reader: ObjectId) {
        if !self.turns.contains(&reader) {
            self.turns.push_back(reader);
        }
    }

    /// Takes the turns of `reader` away.
    pub(crate) fn forget(&mut self, reader: ObjectId) {
        self.turns.retain(|id| *id != reader);
    }

    /// An ACKNACK of this stream.
    pub(crate) fn acknowledge(&mut self, now: Nanos, acknack: &AckNack) {
        if let Machine::Reliable { machine, .. } = &mut self.machine {
            machine.acknowledge(now, acknack.first_unacked, acknack.missing);
        }
    }

    /// The HEARTBEAT to send, if its time has come.
    pub(crate) fn take_heartbeat(&mut self, now: Nanos) -> Option<Heartbeat> {
        match &mut self.machine {
            Machine::BestEffort(_) => None,
            Machine::Reliable { machine, .. } => machine.take_heartbeat(now),
        }
    }

    /// When the next HEARTBEAT is due.
    pub(crate) fn deadline(&self) -> Option<Nanos> {
        match &self.machine {
            Machine::BestEffort(_) => None,
            Machine::Reliable { machine, .. } => machine.next_deadline(),
        }
    }

    /// A HEARTBEAT that is only to be answered, on a reliable stream where all is acknowledged.
    pub(crate) fn probe(&self) -> Option<Heartbeat> {
        match &self.machine {
            Machine::Reliable { machine, .. } if machine.is_idle() => {
                let first: SeqNum = machine.first_unacknowledged();
                Some(Heartbeat {
                    first,
                    last: first.previous(),
                    stream: self.stream(),
                })
            }
            _ => None,
        }
    }

    /// Hands one datagram to `send`; returns whether there was one.
    pub(crate) fn send_one(
        &mut self,
        now: Nanos,
        entities: &mut Entities,
        counters: &Counters,
        send: &mut dyn FnMut(&[u8]),
    ) -> bool {
        loop {
            if self.machine.send_one(now, counters, send) {
                return true;
            }
            if !self.machine.has_room(now) || !self.fill(entities, counters) {
                return false;
            }
        }
    }

    /// Gives the stream its next submessage; returns whether there was one.
    fn fill(&mut self, entities: &mut Entities, counters: &Counters) -> bool {
        if let Some(status) = self.statuses.pop_front() {
            if self.machine.push(&status).is_err() {
                counters.replies_dropped.hit();
            }
            return true;
        }
        let stream = self.stream();
        while let Some(id) = self.turns.pop_front() {
            let Some(reader) = entities.reader(id) else {
                continue;
            };
            let Some((request, sample)) = reader.next_on(stream) else {
                continue;
            };
            match self.machine.push(&Data {
                base: request,
                payload: sample,
            }) {
                Ok(()) => {
                    reader.delivered();
                    counters.samples_out.hit();
                }
                Err(PushError::WouldBlock) => {
                    self.turns.push_front(id);
                    return false;
                }
                Err(_too_large) => {
                    reader.discard();
                    counters.samples_refused.hit();
                }
            }
            if reader.ready() == Some(stream) {
                self.turns.push_back(id);
            }
            return true;
        }
        false
    }
}

impl Machine {
    /// Whether a submessage pushed now goes out now.
    fn has_room(&self, now: Nanos) -> bool {
        match self {
            Self::BestEffort(machine) => !machine.has_message(),
            Self::Reliable { machine, capacity } => {
                capacity - machine.free() < usize::from(IN_FLIGHT) && !machine.has_message(now)
            }
        }
    }

    fn push(&mut self, body: &impl Encode) -> Result<(), PushError> {
        match self {
            Self::BestEffort(machine) => machine.push(body),
            Self::Reliable { machine, .. } => machine.push(body),
        }
    }

    fn send_one(&mut self, now: Nanos, counters: &Counters, send: &mut dyn FnMut(&[u8])) -> bool {
        match self {
            Self::BestEffort(machine) => machine.take().map(send).is_some(),
            Self::Reliable { machine, .. } => {
                let resent = machine.stats().resent;
                let sent = machine.next_datagram(now).map(send).is_some();
                if machine.stats().resent != resent {
                    counters.retransmitted.hit();
                }
                sent
            }
        }
    }
}
