//! One stream from the agent to a client, and the readers that send on it.
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

use super::input_stream::InputStream;
use crate::config::{Limits, Service, TopicRule};
use crate::entities::{Entities, Readiness};
use crate::flow::{Charge, Ledger, TRACKER_BYTES, TrackerHandle, WeightedRoundRobin};
use crate::report::Counters;
use replenish_xrce::stream::{
    OutputBestEffort, OutputReliable, PushError, Reliability, StreamHeader, Tail,
};
use replenish_xrce::wire::{
    AckNack, Encode, Heartbeat, Notice, ObjectId, StatusReply, StreamId, submessage_len,
};
use replenish_xrce::{Nanos, SeqNum};
use std::collections::VecDeque;

/// Unacknowledged messages: as many as the client's ACKNACK can name.
const IN_FLIGHT: u16 = 16;

/// The part of them that is reserved for topics above the default priority, if there are any:
/// these need not wait until an acknowledgement makes room.
const RESERVED: u16 = 4;

/// Messages that a reliable stream can hold: a sample in fragments besides those in flight. A
/// sample of more fragments waits beside them.
const SLOTS: usize = 256;

/// The most statuses that wait.
const MAX_STATUSES: usize = 64;

/// Bytes of a reliable stream besides its messages, and those of each message for its tracker.
const OVERHEAD: usize = size_of::<OutputReliable<Box<[u8]>, SLOTS>>();
const TRACKED: usize = 2 * size_of::<(SeqNum, TrackerHandle)>() + TRACKER_BYTES;

/// The most urgent level: answers, acknowledgements.
pub(crate) const TOP: u8 = 7;

/// Bytes of a stream in both directions that no account of a client has: what is left of it when
/// its messages are counted, its statuses and its turns.
pub(crate) const STREAM_BYTES: usize = size_of::<InputStream>()
    + size_of::<OutputStream>()
    + 2 * MAX_STATUSES * size_of::<StatusReply>();

/// Readers that may send again at some time.
pub(crate) type Throttled = Vec<(Nanos, ObjectId)>;

/// Notes that `reader` may send again `at`, once for each reader.
pub(crate) fn throttle(throttled: &mut Throttled, at: Nanos, reader: ObjectId) {
    throttled.retain(|(_, id)| *id != reader);
    throttled.push((at, reader));
}

/// A stream's sending end.
#[derive(Debug)]
pub(crate) struct OutputStream {
    sender: Sender,
    statuses: VecDeque<StatusReply>,
    /// Notices that wait; one of a kind for each object.
    notices: VecDeque<StatusReply>,
    round_robin: WeightedRoundRobin,
    /// The urgency of the submessage that the sender got last.
    level: u8,
    /// A reader above the default priority sends on this stream.
    reserve: bool,
    /// Samples whose length no submessage can say may go to the client: eProsima's takes none.
    long: bool,
    /// The trackers to release when a message has arrived, by its number; the oldest first.
    trackers: VecDeque<(SeqNum, TrackerHandle)>,
    _charge: Charge,
}

#[derive(Debug)]
enum Sender {
    BestEffort(OutputBestEffort<Box<[u8]>>),
    Reliable {
        sender: Box<OutputReliable<Box<[u8]>, SLOTS>>,
        capacity: usize,
    },
}

impl OutputStream {
    /// A stream at its beginning, for a client that takes messages of up to `mtu` bytes. `None` if
    /// the client may not have the memory.
    pub(crate) fn new(
        header: StreamHeader,
        mtu: usize,
        limits: &Limits,
        ledger: &Ledger,
    ) -> Option<Self> {
        let piece = mtu.saturating_sub(header.session.header_len() + 4).max(1);
        let longest = limits.longest_submessage();
        let slots = if header.stream.is_reliable() {
            longest.div_ceil(piece) + usize::from(IN_FLIGHT)
        } else {
            1
        };
        let beside = if slots > SLOTS { longest } else { 0 };
        let bytes = slots.min(SLOTS) * mtu;
        let overhead = if header.stream.is_reliable() {
            OVERHEAD + slots.min(SLOTS) * TRACKED
        } else {
            0
        };
        let charge = ledger.charge(bytes + beside + overhead)?;
        let buf = vec![0; bytes].into_boxed_slice();
        let sender = if header.stream.is_reliable() {
            let config = Reliability {
                in_flight: IN_FLIGHT,
                ..Reliability::default()
            };
            let mut sender = OutputReliable::new(buf, mtu, header, Tail::Exact, config);
            if beside > 0 {
                sender = sender.with_spill(vec![0; beside].into_boxed_slice());
            }
            let sender = Box::new(sender);
            let capacity = sender.free();
            Sender::Reliable { sender, capacity }
        } else {
            Sender::BestEffort(OutputBestEffort::new(buf, header, Tail::Exact))
        };
        Some(Self {
            sender,
            statuses: VecDeque::new(),
            notices: VecDeque::new(),
            round_robin: WeightedRoundRobin::default(),
            level: TOP,
            reserve: false,
            long: limits.takes_long_samples(),
            trackers: VecDeque::new(),
            _charge: charge,
        })
    }

    pub(crate) fn stream(&self) -> StreamId {
        match &self.sender {
            Sender::BestEffort(sender) => sender.header().stream,
            Sender::Reliable { sender, .. } => sender.header().stream,
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

    /// Queues a notice about an object, in the place of an earlier one of the same kind;
    /// incompatible policies add up.
    pub(crate) fn notice(&mut self, object: ObjectId, notice: Notice) {
        let kind = notice.about(object);
        let same = |n: &&mut StatusReply| (n.base, n.status) == (kind.base, kind.status);
        match (self.notices.iter_mut().find(same), notice) {
            (None, _) => self.notices.push_back(kind),
            (Some(before), Notice::IncompatibleQos(policies)) => before.implementation |= policies,
            (Some(before), Notice::Served(_)) => *before = kind,
        }
    }

    /// Gives `reader` a turn, because it has a sample for this stream.
    pub(crate) fn queue(&mut self, reader: ObjectId, service: Service) {
        self.reserve |= service.priority > TopicRule::DEFAULT_PRIORITY;
        self.round_robin.queue(reader, service);
    }

    /// Removes `reader` and its notices.
    pub(crate) fn forget(&mut self, reader: ObjectId) {
        self.round_robin.forget(reader);
        self.notices.retain(|notice| notice.base.object != reader);
    }

    /// Whether readers wait for their turn.
    pub(crate) fn has_samples(&self) -> bool {
        self.round_robin.top().is_some()
    }

    /// The urgency of the next datagram, with `samples` or without; `None` if there is none now.
    pub(crate) fn urgency(&self, now: Nanos, samples: bool) -> Option<u8> {
        if self.sender.has_message(now) {
            return Some(self.level);
        }
        let level = self.next_level(samples)?;
        self.has_room(now, level).then_some(level)
    }

    /// The urgency of the next submessage.
    fn next_level(&self, samples: bool) -> Option<u8> {
        if self.statuses.is_empty() && self.notices.is_empty() {
            self.round_robin.top().filter(|_| samples)
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
        self.sender.has_room(now, IN_FLIGHT - reserved)
    }

    /// An ACKNACK of this stream. Returns whether it acknowledges a message that was sent.
    pub(crate) fn acknowledge(&mut self, now: Nanos, acknack: &AckNack) -> bool {
        if let Sender::Reliable { sender, .. } = &mut self.sender {
            let before = sender.first_unacknowledged();
            sender.acknowledge(now, acknack.first_unacked, acknack.missing);
            let first = sender.first_unacknowledged();
            while self
                .trackers
                .front()
                .is_some_and(|(last, _)| first.is_after(*last))
            {
                self.trackers.pop_front();
            }
            return first.is_after(before);
        }
        false
    }

    /// Whether a sample has been under way for longer than `limit`.
    pub(crate) fn lags(&self, now: Nanos, limit: Nanos) -> bool {
        let oldest = self.trackers.front();
        oldest.is_some_and(|(_, tracker)| tracker.since.saturating_add(limit) <= now)
    }

    /// The HEARTBEAT to send, if its time has come.
    pub(crate) fn take_heartbeat(&mut self, now: Nanos) -> Option<Heartbeat> {
        match &mut self.sender {
            Sender::BestEffort(_) => None,
            Sender::Reliable { sender, .. } => sender.take_heartbeat(now),
        }
    }

    /// Time at which the next HEARTBEAT is due.
    pub(crate) fn deadline(&self) -> Option<Nanos> {
        match &self.sender {
            Sender::BestEffort(_) => None,
            Sender::Reliable { sender, .. } => sender.next_deadline(),
        }
    }

    /// A HEARTBEAT that is only to be answered, on a reliable stream where all is acknowledged, or,
    /// if it is `urgent`, on any.
    pub(crate) fn probe(&self, urgent: bool) -> Option<Heartbeat> {
        match &self.sender {
            Sender::Reliable { sender, .. } if urgent || sender.is_idle() => {
                let first: SeqNum = sender.first_unacknowledged();
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
        match &self.sender {
            Sender::BestEffort(_) => 0,
            Sender::Reliable { sender, .. } => sender.stats().resent,
        }
    }

    /// Messages that are not acknowledged.
    pub(crate) fn unacknowledged(&self) -> usize {
        match &self.sender {
            Sender::BestEffort(_) => 0,
            Sender::Reliable { sender, .. } => sender.unacknowledged(),
        }
    }

    /// Hands one datagram, with `samples` or without, to `send`; returns whether there was one.
    pub(crate) fn send_one(
        &mut self,
        now: Nanos,
        samples: bool,
        (entities, throttled): (&mut Entities, &mut Throttled),
        counters: &Counters,
        send: &mut dyn FnMut(&[u8]),
    ) -> bool {
        loop {
            if self.sender.send_one(now, counters, send) {
                return true;
            }
            let room = self
                .next_level(samples)
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
            if self.sender.push(&status).is_err() {
                counters.replies_dropped.hit();
            }
            return true;
        }
        if let Some(notice) = self.notices.front() {
            self.level = TOP;
            // A notice that does not fit is not worth more than the samples behind it.
            let _lost = self.sender.push(notice).is_err();
            self.notices.pop_front();
            return true;
        }
        let stream = self.stream();
        while let Some(id) = self.round_robin.front() {
            let Some(reader) = entities.reader(id) else {
                self.round_robin.served(false);
                continue;
            };
            let mut is_ready = |readiness| match readiness {
                Readiness::Now(on) => on == stream,
                Readiness::Idle => false,
                Readiness::At(at) => {
                    throttle(throttled, at, id);
                    false
                }
            };
            if !is_ready(reader.readiness(now, counters)) {
                self.round_robin.served(false);
                continue;
            }
            let Some(data) = reader.next() else {
                self.round_robin.served(false);
                continue;
            };
            // A request has 24 bytes, and a reply 4, besides what `limits.sample` counts.
            let pushed = match submessage_len(&data) {
                Err(error) if !self.long => Err(PushError::Wire(error)),
                _ => self.sender.push(&data),
            };
            match pushed {
                Ok(()) => {
                    self.level = reader.service.priority;
                    let tracker = reader.delivered(now);
                    let last = self.sender.newest();
                    self.trackers.extend(last.zip(tracker));
                    counters.samples_out.hit();
                }
                Err(PushError::WouldBlock) => return false,
                Err(_too_large) => {
                    reader.discard();
                    counters.samples_refused.hit();
                }
            }
            let more = is_ready(reader.readiness(now, counters));
            self.round_robin.served(more);
            return true;
        }
        false
    }
}

impl Sender {
    /// Whether there is something to send without being pushed anything.
    fn has_message(&self, now: Nanos) -> bool {
        match self {
            Self::BestEffort(sender) => sender.has_message(),
            Self::Reliable { sender, .. } => sender.has_message(now),
        }
    }

    /// Whether a submessage pushed now goes out now, with `window` messages in flight.
    fn has_room(&self, now: Nanos, window: u16) -> bool {
        match self {
            Self::BestEffort(sender) => !sender.has_message(),
            Self::Reliable { sender, capacity } => {
                capacity - sender.free() < usize::from(window) && !sender.has_message(now)
            }
        }
    }

    /// The number of the message that was pushed last, on a reliable stream.
    fn newest(&self) -> Option<SeqNum> {
        match self {
            Self::BestEffort(_) => None,
            Self::Reliable { sender, .. } => Some(sender.newest()),
        }
    }

    fn push(&mut self, body: &impl Encode) -> Result<(), PushError> {
        match self {
            Self::BestEffort(sender) => sender.push(body),
            Self::Reliable { sender, .. } => sender.push(body),
        }
    }

    fn send_one(&mut self, now: Nanos, counters: &Counters, send: &mut dyn FnMut(&[u8])) -> bool {
        match self {
            Self::BestEffort(sender) => sender.take().map(send).is_some(),
            Self::Reliable { sender, .. } => {
                let resent = sender.stats().resent;
                let sent = sender.next_datagram(now).map(send).is_some();
                if sender.stats().resent != resent {
                    counters.retransmitted.hit();
                }
                sent
            }
        }
    }
}
