//! One stream from the agent to a client, with everyone who wants to send on it.
//!
//! ```text
//!   statuses ──────────────┐ first
//!   reader ─┐              ▼
//!   reader ─┼─► turns ──► stream ──► datagrams
//!   reader ─┘  one sample at a time, the most urgent first
//! ```
//!
//! Samples stay in their readers' queues, where keep-last applies, until the stream can really
//! send them: nothing is queued twice, and a reader with a backlog takes turns with the others
//! instead of standing before them.
//!
//! Each datagram carries one submessage, as those of eProsima's agents do: their client skips what
//! is packed behind a service reply.

use crate::config::{Limits, Service, TopicRule};
use crate::entities::{Entities, Readiness};
use crate::flow::{Charge, Ledger, Receipt, Turns};
use crate::report::Counters;
use replenish_xrce::stream::{
    OutputBestEffort, OutputReliable, PushError, Reliability, StreamHeader, Tail,
};
use replenish_xrce::wire::{AckNack, Encode, Heartbeat, Notice, ObjectId, StatusReply, StreamId};
use replenish_xrce::{Nanos, SeqNum};
use std::collections::VecDeque;

/// Unacknowledged messages: what the client's ACKNACK can name.
const IN_FLIGHT: u16 = 16;

/// So many of them are kept free for what is more urgent than the rest, where there is such a thing:
/// it need not wait until an acknowledgement makes room.
const RESERVED: u16 = 4;

/// Messages that a reliable stream can hold: a sample in fragments besides those in flight.
const SLOTS: usize = 256;

/// Statuses that may wait.
const MAX_STATUSES: usize = 64;

/// The most urgent level: answers, acknowledgements.
pub(crate) const TOP: u8 = 7;

/// Readers that may send again at some time.
pub(crate) type Throttled = Vec<(Nanos, ObjectId)>;

/// A stream's sending end.
#[derive(Debug)]
pub(crate) struct Outlet {
    machine: Machine,
    statuses: VecDeque<StatusReply>,
    /// What the client is told unasked; one of a kind for each object.
    notices: VecDeque<StatusReply>,
    turns: Turns,
    /// How urgent what was handed to the machine last is.
    level: u8,
    /// Somebody more urgent than the rest sends on this stream.
    reserve: bool,
    /// What to let go of when the message with that number has arrived; the oldest first.
    receipts: VecDeque<(SeqNum, Receipt)>,
    _charge: Charge,
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
    /// `None` if the client may not have so much memory.
    pub(crate) fn new(
        header: StreamHeader,
        mtu: usize,
        limits: &Limits,
        ledger: &Ledger,
    ) -> Option<Self> {
        let piece = mtu.saturating_sub(header.len() + 4).max(1);
        let slots = if header.stream.is_reliable() {
            limits.longest_submessage().div_ceil(piece) + usize::from(IN_FLIGHT)
        } else {
            1
        };
        let bytes = slots.min(SLOTS) * mtu;
        let charge = ledger.charge(bytes)?;
        let buf = vec![0; bytes].into_boxed_slice();
        let machine = if header.stream.is_reliable() {
            let config = Reliability {
                in_flight: IN_FLIGHT,
                ..Reliability::default()
            };
            let machine = Box::new(OutputReliable::new(buf, mtu, header, Tail::Exact, config));
            let capacity = machine.free();
            Machine::Reliable { machine, capacity }
        } else {
            Machine::BestEffort(OutputBestEffort::new(buf, header, Tail::Exact))
        };
        Some(Self {
            machine,
            statuses: VecDeque::new(),
            notices: VecDeque::new(),
            turns: Turns::default(),
            level: TOP,
            reserve: false,
            receipts: VecDeque::new(),
            _charge: charge,
        })
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

    /// Queues what the client is told unasked about an object. What it was to be told about the same
    /// thing before is out of date, except that clashing policies add up.
    pub(crate) fn notice(&mut self, object: ObjectId, notice: Notice) {
        let kind = notice.about(object);
        let same = |n: &&mut StatusReply| (n.base, n.status) == (kind.base, kind.status);
        match (self.notices.iter_mut().find(same), notice) {
            (None, _) => self.notices.push_back(kind),
            (Some(before), Notice::Clash(policies)) => before.implementation |= policies,
            (Some(before), Notice::Served(_)) => *before = kind,
        }
    }

    /// Gives `reader` a turn, because it has a sample for this stream.
    pub(crate) fn queue(&mut self, reader: ObjectId, service: Service) {
        self.reserve |= service.priority > TopicRule::DEFAULT_PRIORITY;
        self.turns.queue(reader, service);
    }

    /// Takes the turns of `reader` away.
    pub(crate) fn forget(&mut self, reader: ObjectId) {
        self.turns.forget(reader);
        self.notices.retain(|notice| notice.base.object != reader);
    }

    /// How urgent what can be sent now is; `None` if there is nothing.
    pub(crate) fn urgency(&self, now: Nanos) -> Option<u8> {
        if self.machine.has_message(now) {
            return Some(self.level);
        }
        let level = self.next_level()?;
        self.has_room(now, level).then_some(level)
    }

    /// How urgent the next submessage is.
    fn next_level(&self) -> Option<u8> {
        if self.statuses.is_empty() && self.notices.is_empty() {
            self.turns.top()
        } else {
            Some(TOP)
        }
    }

    /// Whether a submessage pushed now goes out now.
    fn has_room(&self, now: Nanos, level: u8) -> bool {
        let ordinary = level <= TopicRule::DEFAULT_PRIORITY;
        let reserved = if self.reserve && ordinary {
            RESERVED
        } else {
            0
        };
        self.machine.has_room(now, IN_FLIGHT - reserved)
    }

    /// An ACKNACK of this stream.
    pub(crate) fn acknowledge(&mut self, now: Nanos, acknack: &AckNack) {
        if let Machine::Reliable { machine, .. } = &mut self.machine {
            machine.acknowledge(now, acknack.first_unacked, acknack.missing);
            let first = machine.first_unacknowledged();
            while self
                .receipts
                .front()
                .is_some_and(|(last, _)| first.is_after(*last))
            {
                self.receipts.pop_front();
            }
        }
    }

    /// Whether a sample has been under way for longer than `patience`.
    pub(crate) fn lags(&self, now: Nanos, patience: Nanos) -> bool {
        let oldest = self.receipts.front();
        oldest.is_some_and(|(_, receipt)| receipt.since.saturating_add(patience) <= now)
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

    /// Messages that were sent again.
    pub(crate) fn resent(&self) -> u64 {
        match &self.machine {
            Machine::BestEffort(_) => 0,
            Machine::Reliable { machine, .. } => machine.stats().resent,
        }
    }

    /// Messages that are not acknowledged.
    pub(crate) fn unacknowledged(&self) -> usize {
        match &self.machine {
            Machine::BestEffort(_) => 0,
            Machine::Reliable { machine, .. } => machine.unacknowledged(),
        }
    }

    /// Hands one datagram to `send`; returns whether there was one.
    pub(crate) fn send_one(
        &mut self,
        now: Nanos,
        entities: &mut Entities,
        throttled: &mut Throttled,
        counters: &Counters,
        send: &mut dyn FnMut(&[u8]),
    ) -> bool {
        loop {
            if self.machine.send_one(now, counters, send) {
                return true;
            }
            let room = self
                .next_level()
                .is_some_and(|level| self.has_room(now, level));
            if !room || !self.fill(now, entities, throttled, counters) {
                return false;
            }
        }
    }

    /// Gives the stream its next submessage; returns whether there was one.
    fn fill(
        &mut self,
        now: Nanos,
        entities: &mut Entities,
        throttled: &mut Throttled,
        counters: &Counters,
    ) -> bool {
        if let Some(status) = self.statuses.pop_front() {
            self.level = TOP;
            if self.machine.push(&status).is_err() {
                counters.replies_dropped.hit();
            }
            return true;
        }
        if let Some(notice) = self.notices.front() {
            self.level = TOP;
            // One that does not fit is not worth more than the samples behind it.
            let _lost = self.machine.push(notice).is_err();
            self.notices.pop_front();
            return true;
        }
        let stream = self.stream();
        while let Some(id) = self.turns.front() {
            let Some(reader) = entities.reader(id) else {
                self.turns.served(false);
                continue;
            };
            let mut is_ready = |readiness| match readiness {
                Readiness::Now(on) => on == stream,
                Readiness::Idle => false,
                Readiness::At(at) => {
                    throttled.push((at, id));
                    false
                }
            };
            if !is_ready(reader.readiness(now, counters)) {
                self.turns.served(false);
                continue;
            }
            let Some(pushed) = reader.next().map(|data| self.machine.push(&data)) else {
                self.turns.served(false);
                continue;
            };
            match pushed {
                Ok(()) => {
                    self.level = reader.service.priority;
                    let receipt = reader.delivered(now);
                    let last = self.machine.newest();
                    self.receipts.extend(last.zip(receipt));
                    counters.samples_out.hit();
                }
                Err(PushError::WouldBlock) => return false,
                Err(_too_large) => {
                    reader.discard();
                    counters.samples_refused.hit();
                }
            }
            let more = is_ready(reader.readiness(now, counters));
            self.turns.served(more);
            return true;
        }
        false
    }
}

impl Machine {
    /// Whether there is something to send without being pushed anything.
    fn has_message(&self, now: Nanos) -> bool {
        match self {
            Self::BestEffort(machine) => machine.has_message(),
            Self::Reliable { machine, .. } => machine.has_message(now),
        }
    }

    /// Whether a submessage pushed now goes out now, with `window` messages in flight.
    fn has_room(&self, now: Nanos, window: u16) -> bool {
        match self {
            Self::BestEffort(machine) => !machine.has_message(),
            Self::Reliable { machine, capacity } => {
                capacity - machine.free() < usize::from(window) && !machine.has_message(now)
            }
        }
    }

    /// The number of the message that was pushed last, on a reliable stream.
    fn newest(&self) -> Option<SeqNum> {
        match self {
            Self::BestEffort(_) => None,
            Self::Reliable { machine, .. } => Some(machine.newest()),
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
