//! The receiving half of data readers, requesters and repliers: the samples that wait for a client.
//!
//! ```text
//!   offer ──► mine? room? ──► queue ──► lifespan over? rate? ──► next ──► delivered
//!               │   └─ keep-last: the oldest goes                 (DATA)
//!               └─ requester: only replies to its own requests
//! ```
//!
//! Samples are kept from the reader's creation on, so that nothing written between CREATE and
//! `READ_DATA` is lost within the queue's depth.

use super::calls::Calls;
use super::delivery::Delivery;
use super::qos::Qos;
use super::topics::TopicId;
use crate::config::Service;
use crate::flow::{Charge, Identity, Ledger, Sample, TrackerHandle, shrink};
use crate::report::Counters;
use replenish_xrce::Nanos;
use replenish_xrce::wire::{BaseRequest, StreamId};
use std::collections::VecDeque;

/// Bytes that a queued sample is counted with besides its own: it and its place in the queue.
pub(crate) const QUEUE_OVERHEAD: usize =
    Sample::OVERHEAD + shrink::SPARE * size_of::<QueuedSample>();

/// The kind of entity that reads.
#[derive(Debug)]
pub(crate) enum Role {
    /// A data reader.
    Data,
    /// A requester, with the requests that wait for replies.
    Requester(Calls),
    /// A replier.
    Replier,
}

/// The bytes before a sample's own in DATA.
#[derive(Clone, Copy, Debug)]
enum Prefix {
    None,
    Request(Identity),
    Reply(BaseRequest),
}

/// The receiving half of an entity.
#[derive(Debug)]
pub(crate) struct Reader {
    pub(crate) topic: TopicId,
    pub(crate) qos: Qos,
    pub(crate) service: Service,
    pub(crate) role: Role,
    queue: VecDeque<QueuedSample>,
    delivery: Option<Delivery>,
    /// The client has asked for samples on a reliable stream, and may ask for more.
    waits: bool,
    /// The stream that it asked on.
    asked_on: StreamId,
    /// Time at which the last sample was kept.
    last: Option<Nanos>,
    /// Since when writers wait without the queue getting shorter.
    pub(crate) full_since: Option<Nanos>,
    pub(crate) counts: ReaderCounts,
}

#[derive(Debug)]
struct QueuedSample {
    sample: Sample,
    prefix: Prefix,
    tracker: Option<TrackerHandle>,
    _charge: Charge,
}

/// The counters of a reader.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ReaderCounts {
    pub(crate) kept: u64,
    pub(crate) delivered: u64,
    pub(crate) delivered_bytes: u64,
    pub(crate) dropped: u64,
    pub(crate) expired: u64,
}

/// Whether a reader has something to send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Readiness {
    /// Nothing waits, or the client does not want it.
    Idle,
    /// It may be delivered on this stream, now.
    Now(StreamId),
    /// The sample may not go before this time.
    At(Nanos),
}

impl Reader {
    pub(crate) fn new(topic: TopicId, qos: Qos, service: Service, role: Role) -> Self {
        Self {
            topic,
            qos,
            service,
            role,
            queue: VecDeque::new(),
            delivery: None,
            waits: false,
            asked_on: StreamId::NONE,
            last: None,
            full_since: None,
            counts: ReaderCounts::default(),
        }
    }

    /// Whether a sample offered at `now` must reach the client before it counts as confirmed: it is
    /// wanted on a reliable stream, and the queue does not lag behind by `limit`.
    pub(crate) fn is_awaited(&self, now: Nanos, limit: Nanos) -> bool {
        let oldest = self.queue.iter().find_map(|queued| queued.tracker.as_ref());
        let lags = oldest.is_some_and(|tracker| tracker.since.saturating_add(limit) <= now);
        self.waits && self.qos.reliable && !lags
    }

    /// The stream that the client wants samples on.
    pub(crate) fn stream(&self) -> Option<StreamId> {
        self.delivery.as_ref().map(|delivery| delivery.stream)
    }

    /// Keeps a sample, and `tracker` with it, if it is for this reader and there is room; returns
    /// whether it did.
    pub(crate) fn offer(
        &mut self,
        sample: &Sample,
        tracker: Option<&TrackerHandle>,
        now: Nanos,
        ledger: &Ledger,
        counters: &Counters,
    ) -> bool {
        let prefix = match &mut self.role {
            Role::Data => Prefix::None,
            Role::Replier => match sample.info().request {
                Some(identity) => Prefix::Request(identity),
                None => return false,
            },
            Role::Requester(calls) => match sample.info().reply_to.map(|to| calls.answer(to)) {
                Some(Some(base)) => Prefix::Reply(base),
                _ => return false,
            },
        };
        let too_soon = |last: Nanos, least: Nanos| now < last.saturating_add(least);
        if let (Some(last), Some(least)) = (self.last, self.qos.separation)
            && too_soon(last, least)
        {
            counters.samples_filtered.hit();
            return false;
        }
        self.expire(now, counters);
        let charge = self.make_room(sample.len() + QUEUE_OVERHEAD, ledger, counters);
        let Some(charge) = charge else {
            self.count_dropped(counters);
            return false;
        };
        self.last = Some(now);
        self.counts.kept += 1;
        self.queue.push_back(QueuedSample {
            sample: sample.clone(),
            prefix,
            tracker: tracker.cloned(),
            _charge: charge,
        });
        true
    }

    fn make_room(&mut self, bytes: usize, ledger: &Ledger, counters: &Counters) -> Option<Charge> {
        if self.qos.keep_all {
            let full = self.queue.len() >= self.qos.depth;
            return if full { None } else { ledger.charge(bytes) };
        }
        while self.queue.len() >= self.qos.depth.max(1) {
            shrink::pop_front(&mut self.queue);
            self.count_dropped(counters);
        }
        loop {
            if let Some(charge) = ledger.charge(bytes) {
                return Some(charge);
            }
            shrink::pop_front(&mut self.queue)?;
            self.count_dropped(counters);
        }
    }

    fn count_dropped(&mut self, counters: &Counters) {
        self.counts.dropped += 1;
        counters.samples_dropped.hit();
    }

    fn expire(&mut self, now: Nanos, counters: &Counters) {
        while self.queue.front().is_some_and(|p| p.sample.is_expired(now)) {
            shrink::pop_front(&mut self.queue);
            self.counts.expired += 1;
            counters.samples_expired.hit();
            self.full_since = None;
        }
    }

    /// Whether a reliable keep-all writer has to wait with a sample of `bytes`: the queue is full,
    /// or takes all the memory that its client may have, and the client wants what is in it.
    ///
    /// A writer that has waited goes on when half of the queue is free: its client sends a message
    /// anew.
    /// After `limit` in which nothing left the queue, no writer waits any more.
    pub(crate) fn holds_up(
        &mut self,
        now: Nanos,
        (bytes, has_waited): (usize, bool),
        ledger: &Ledger,
        limit: Option<Nanos>,
    ) -> bool {
        let wanted = self.delivery.is_some() || self.waits;
        let presses = self.qos.keep_all && self.qos.reliable && wanted;
        let fills = has_waited && self.queue.len() > self.qos.depth / 2;
        if !(presses && (fills || self.lacks_room(bytes, ledger))) {
            return false;
        }
        let since = *self.full_since.get_or_insert(now);
        limit.is_none_or(|limit| now < since.saturating_add(limit))
    }

    fn lacks_room(&self, bytes: usize, ledger: &Ledger) -> bool {
        let short = ledger.free() < bytes.saturating_add(QUEUE_OVERHEAD);
        // Memory that others hold never comes back through this queue.
        self.queue.len() >= self.qos.depth || (short && !self.queue.is_empty())
    }

    /// The stream on which the client must ask before it gets more, if it must.
    pub(crate) fn spent_on(&self) -> Option<StreamId> {
        (self.waits && self.delivery.is_none()).then_some(self.asked_on)
    }

    /// Replaces or (with `None`) cancels the read request, which came on stream `asked_on`.
    pub(crate) fn request(&mut self, delivery: Option<Delivery>, asked_on: StreamId) {
        self.waits = delivery.is_some_and(|delivery| delivery.stream.is_reliable());
        self.delivery = delivery;
        self.asked_on = asked_on;
    }

    /// Whether the client has asked for samples.
    pub(crate) fn is_reading(&self) -> bool {
        self.delivery.is_some()
    }

    /// Samples that wait.
    pub(crate) fn queued(&self) -> usize {
        self.queue.len()
    }

    /// Whether it has a sample to send.
    pub(crate) fn readiness(&mut self, now: Nanos, counters: &Counters) -> Readiness {
        self.expire(now, counters);
        if let Some(delivery) = self.delivery.filter(|delivery| delivery.is_over(now)) {
            self.waits &= delivery.is_used_up(); // then the client may grant more
            self.delivery = None;
        }
        let (Some(delivery), Some(queued)) = (&self.delivery, self.queue.front()) else {
            return Readiness::Idle;
        };
        match delivery.earliest(queued.len()) {
            at if at > now => Readiness::At(at),
            _ => Readiness::Now(delivery.stream),
        }
    }

    /// The next DATA. Only right after [`readiness`](Self::readiness) said so.
    pub(crate) fn next(&self) -> Option<Outgoing<'_>> {
        let base = self.delivery.as_ref()?.base;
        let queued = self.queue.front()?;
        let prefix = match queued.prefix {
            Prefix::None => PrefixBytes::None,
            Prefix::Request(identity) => PrefixBytes::Request(identity.to_bytes()),
            Prefix::Reply(base) => {
                let [r0, r1] = base.request.0.to_be_bytes();
                let [o0, o1] = base.object.to_bytes();
                PrefixBytes::Reply([r0, r1, o0, o1])
            }
        };
        Some(Outgoing {
            base,
            prefix,
            payload: &queued.sample,
        })
    }

    /// The next sample is on its way; gives the tracker to keep until it has arrived.
    pub(crate) fn delivered(&mut self, now: Nanos) -> Option<TrackerHandle> {
        self.full_since = None;
        let queued = shrink::pop_front(&mut self.queue)?;
        self.counts.delivered += 1;
        self.counts.delivered_bytes += queued.sample.len() as u64;
        if let Some(delivery) = &mut self.delivery {
            delivery.spend(now, queued.len());
        }
        queued.tracker
    }

    /// The next sample cannot be delivered.
    pub(crate) fn discard(&mut self) {
        shrink::pop_front(&mut self.queue);
        self.counts.dropped += 1;
    }
}

impl QueuedSample {
    /// Bytes it takes in DATA.
    fn len(&self) -> usize {
        let prefix = match self.prefix {
            Prefix::None => 0,
            Prefix::Request(_) => Identity::LEN,
            Prefix::Reply(_) => 4,
        };
        prefix + self.sample.len()
    }
}

/// The contents of a DATA.
#[derive(Debug)]
pub(crate) struct Outgoing<'a> {
    pub(crate) base: BaseRequest,
    prefix: PrefixBytes,
    payload: &'a [u8],
}

#[derive(Debug)]
enum PrefixBytes {
    None,
    Request([u8; Identity::LEN]),
    Reply([u8; 4]),
}

impl replenish_xrce::wire::Encode for Outgoing<'_> {
    fn id(&self) -> replenish_xrce::wire::SubmessageId {
        replenish_xrce::wire::SubmessageId::Data
    }

    fn write(&self, w: &mut replenish_xrce::wire::Writer<'_>) {
        w.put(&self.base.to_bytes());
        match &self.prefix {
            PrefixBytes::None => {}
            PrefixBytes::Request(bytes) => w.put(bytes),
            PrefixBytes::Reply(bytes) => w.put(bytes),
        }
        w.put(self.payload);
    }
}
