//! The state under a bus's lock: topics, participants, and the way of a sample into the queues of
//! its readers.
//!
//! ```text
//!   participant ── made ──► its place ── dropped ──► free: the next one gets it
//!   topic ── first reader or writer ──► its place ── last one deleted ──► free
//!   reader, writer ── created ──► its place ── deleted ──► free
//! ```
//!
//! A number that outlives its place finds nobody there, or is told apart: a reply by the reader's
//! [stamp](Reader::stamp), a buffer that comes back likewise.

use super::notices::{Clashes, Oversizes};
use crate::handoff::{Ring, RingSlot, SampleInfo};
use crate::middleware::places::{free_place, put};
use crate::middleware::watch::{End, EndStatus, Watches};
use crate::middleware::{EndpointSpec, Interest, Middleware, MiddlewareError, ReaderId, WriterId};
use crate::platform::{Deadline, Lease, LocalReader, STD, TEXTS, label};
use crate::qos::Qos;
use crate::sync::{Arc, Notify};
use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;
use replenish_os::clock;

/// The most participants of one bus.
const MAX_PARTICIPANTS: usize = 64;

/// Whether long samples are copied without the lock, and their least length in bytes.
pub(super) const LONG_SAMPLES: bool = STD;
pub(super) const LONG: usize = 16 * 1024;

#[derive(Default)]
pub(super) struct Bus {
    pub(super) topics: Vec<Topic>,
    /// `None`: a place that is free.
    pub(super) participants: Vec<Option<Participant>>,
    /// The last reader's stamp.
    pub(super) stamp: u32,
    /// The number of the last message that was shared.
    pub(super) shares: u64,
}

#[derive(Default)]
pub(super) struct Topic {
    pub(super) name: String,
    pub(super) type_name: String,
    /// Readers and writers; without any its place is free.
    endpoints: usize,
    /// Participant and reader of each subscription.
    pub(super) readers: Vec<(usize, usize)>,
    /// Some writer and some reader do not fit together.
    pub(super) clashes: bool,
}

pub(super) struct Participant {
    pub(super) bell: Arc<Notify>,
    /// The readers for which its dispatcher waits at this moment.
    pub(super) waits_for: Option<Interest>,
    /// Where the next `take` starts to look, so that no reader starves the others.
    pub(super) next: usize,
    pub(super) readers: Vec<Reader>,
    pub(super) writers: Vec<Writer>,
    /// The full names of its nodes, one for each.
    pub(super) nodes: Vec<Box<str>>,
    /// Endpoints whose QoS does not fit together, as far as it was not reported yet.
    pub(super) clashes: Arc<Clashes>,
    /// Endpoints that a program watches.
    pub(super) watches: Watches,
}

pub(super) struct Writer {
    pub(super) node: Box<str>,
    pub(super) topic: usize,
    pub(super) offers: Qos,
    /// The largest payload it may send.
    pub(super) limit: usize,
    /// Samples sent so far.
    pub(super) sent: u64,
    /// A client's reader of replies, and its stamp.
    pub(super) replies: Option<(usize, u32)>,
    /// The latest samples, for readers that come late (transient local).
    pub(super) kept: Option<Ring>,
    /// It has written a sample as bytes.
    pub(super) wrote_bytes: bool,
    /// Its counts, but for its peers of this moment.
    pub(super) status: EndStatus,
    pub(super) deadline: Deadline,
    /// If it shows itself that it is alive.
    pub(super) lease: Lease,
    /// It was deleted; its place is free.
    pub(super) deleted: bool,
}

pub(super) struct Reader {
    pub(super) id: ReaderId,
    pub(super) node: Box<str>,
    pub(super) topic: usize,
    pub(super) requests: Qos,
    /// The largest sample it takes.
    pub(super) limit: usize,
    pub(super) oversizes: Arc<Oversizes>,
    pub(super) queue: Ring,
    /// The way to its handle for messages in memory.
    pub(super) local: Option<LocalReader<dyn Middleware>>,
    /// The last message that it got as it is in memory.
    pub(super) last_share: u64,
    /// The dispatcher brings one of the queue's buffers to the inbox.
    pub(super) lent: bool,
    pub(super) keep_all: bool,
    pub(super) keep_oldest: bool,
    pub(super) reliable: bool,
    pub(super) lost: u64,
    /// Its counts, but for its peers of this moment.
    pub(super) status: EndStatus,
    pub(super) deadline: Deadline,
    /// It was deleted; its place is free.
    pub(super) deleted: bool,
    /// No other reader of the bus has had it: places are given out again, also to participants.
    pub(super) stamp: u32,
}

impl Bus {
    /// Finds a place for a participant; if there is none, a place without anybody.
    pub(super) fn enter(&mut self, participant: Participant) -> usize {
        let at = free_place(&self.participants, Option::is_none);
        if at < MAX_PARTICIPANTS {
            put(&mut self.participants, at, Some(participant));
        }
        at
    }

    /// A participant goes, and with it all that it has. To be dropped without the lock.
    pub(super) fn leave(&mut self, me: usize) -> Option<Participant> {
        let gone = self.participants.get_mut(me)?.take()?;
        for (at, reader) in gone.readers.iter().enumerate() {
            if !reader.deleted {
                self.unsubscribe(reader.topic, (me, at));
            }
        }
        for writer in gone.writers.iter().filter(|w| !w.deleted) {
            self.part(writer.topic);
        }
        Some(gone)
    }

    pub(super) fn participant(&self, at: usize) -> Option<&Participant> {
        self.participants.get(at)?.as_ref()
    }

    pub(super) fn participant_mut(&mut self, at: usize) -> Option<&mut Participant> {
        self.participants.get_mut(at)?.as_mut()
    }

    /// The participants with their places.
    pub(super) fn participants(&self) -> impl Iterator<Item = (usize, &Participant)> {
        let places = self.participants.iter().enumerate();
        places.filter_map(|(at, place)| Some((at, place.as_ref()?)))
    }

    /// As [`participants`](Self::participants).
    pub(super) fn participants_mut(&mut self) -> impl Iterator<Item = (usize, &mut Participant)> {
        let places = self.participants.iter_mut().enumerate();
        places.filter_map(|(at, place)| Some((at, place.as_mut()?)))
    }

    /// The place of a topic, which has one endpoint more from now on.
    pub(super) fn join(&mut self, spec: &EndpointSpec<'_>) -> Result<usize, MiddlewareError> {
        let mut known = self.topics.iter_mut().enumerate();
        if let Some((at, topic)) = known.find(|(_, t)| t.endpoints > 0 && t.name == spec.topic) {
            if topic.type_name != spec.type_name {
                return Err(MiddlewareError::TypeMismatch {
                    existing: topic.type_name.as_str().into(),
                });
            }
            topic.endpoints += 1;
            return Ok(at);
        }
        let topic = Topic {
            name: spec.topic.into(),
            type_name: spec.type_name.into(),
            endpoints: 1,
            ..Topic::default()
        };
        let at = free_place(&self.topics, |t| t.endpoints == 0);
        put(&mut self.topics, at, topic);
        Ok(at)
    }

    /// A topic has one endpoint less.
    fn part(&mut self, topic: usize) {
        if let Some(topic) = self.topics.get_mut(topic) {
            topic.endpoints = topic.endpoints.saturating_sub(1);
            if topic.endpoints == 0 {
                *topic = Topic::default();
            }
        }
    }

    /// Participant and reader do not belong to the topic any more.
    fn unsubscribe(&mut self, topic: usize, reader: (usize, usize)) {
        if let Some(topic) = self.topics.get_mut(topic) {
            topic.readers.retain(|r| *r != reader);
        }
        self.part(topic);
    }

    pub(super) fn delete_reader(&mut self, me: usize, at: usize) {
        let reader = self.participant_mut(me).and_then(|p| p.readers.get_mut(at));
        if let Some(reader) = reader.filter(|r| !r.deleted) {
            reader.queue.clear();
            reader.local = None;
            reader.deleted = true;
            let (topic, end) = (reader.topic, End::Reader(reader.id));
            self.unwatch(me, end);
            self.unsubscribe(topic, (me, at));
        }
    }

    pub(super) fn delete_writer(&mut self, me: usize, at: usize) {
        let writer = self.participant_mut(me).and_then(|p| p.writers.get_mut(at));
        if let Some(writer) = writer.filter(|w| !w.deleted) {
            writer.deleted = true;
            let topic = writer.topic;
            self.unwatch(me, End::Writer(WriterId(id(at).0)));
            self.part(topic);
        }
    }

    fn unwatch(&mut self, me: usize, end: End) {
        let participant = self.participant_mut(me).into_iter();
        participant.for_each(|participant| participant.watches.remove(end));
    }

    /// A number that no reader of this bus has.
    pub(super) fn next_stamp(&mut self) -> u32 {
        self.stamp = self.stamp.wrapping_add(1);
        self.stamp
    }

    pub(super) fn me(&mut self, me: usize) -> Result<&mut Participant, MiddlewareError> {
        let too_many = MiddlewareError::Capacity {
            what: label("participants of one in-process bus"),
            limit: MAX_PARTICIPANTS,
        };
        self.participant_mut(me).ok_or(too_many)
    }

    /// Gives a reader that comes late what the topic's writers have kept.
    pub(super) fn catch_up(&self, topic: usize, reader: &mut Reader) {
        let writers = self.participants().flat_map(|(_, p)| &p.writers);
        let requests = reader.requests;
        let fits = |w: &&Writer| w.offers.check_offers(requests).is_ok();
        let mine = writers.filter(|w| w.topic == topic && !w.deleted && fits(w));
        for sample in mine.filter_map(|w| w.kept.as_ref()).flat_map(Ring::waiting) {
            let arrival = clock::monotonic();
            if sample.info().expires.is_some_and(|at| at <= arrival) {
                continue;
            }
            let info = SampleInfo {
                arrival,
                ..*sample.info()
            };
            reader.store(sample.payload(), &info);
        }
    }

    /// Copies the sample to every reader of the topic. Returns the participants to wake, as bits,
    /// and whether a reliable reader that keeps all had no room.
    pub(super) fn distribute(
        &mut self,
        (topic, offers): (usize, Qos),
        payload: &[u8],
        info: &SampleInfo,
    ) -> (u64, bool) {
        let (mut wake, mut full) = (0, false);
        let Some(topic) = self.topics.get(topic) else {
            return (wake, full);
        };
        for &(p, r) in &topic.readers {
            let Some(Some(participant)) = self.participants.get_mut(p) else {
                continue;
            };
            let Some(reader) = participant.readers.get_mut(r) else {
                continue;
            };
            if topic.clashes && offers.check_offers(reader.requests).is_err() {
                continue;
            }
            match reader.store(payload, info) {
                Stored::Waits => {
                    if reader.deadline.renew(info.arrival) {
                        wake |= u64::from(!participant.watches.is_empty()) << p;
                    }
                    let waits = participant.waits_for.as_ref();
                    if waits.is_some_and(|i| i.contains(id(r))) {
                        participant.waits_for = None; // one bell is enough
                        wake |= 1 << p;
                    }
                }
                Stored::TooLong => wake |= 1 << p,
                Stored::Lost => {
                    full |= reader.reliable && reader.keep_all;
                    wake |= u64::from(!participant.watches.is_empty()) << p;
                }
            }
        }
        (wake, full)
    }
}

/// The fate of a sample at one reader.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Stored {
    Waits,
    Lost,
    /// Its participant is to be told.
    TooLong,
}

impl Reader {
    /// The oldest sample, for the dispatcher to bring to the inbox, and the reader's stamp.
    pub(super) fn lend(&mut self) -> Option<(RingSlot, u32)> {
        let slot = self.queue.pop()?;
        self.lent = true;
        Some((slot, self.stamp))
    }

    /// Anything that did not find room is counted, or told.
    pub(super) fn store(&mut self, payload: &[u8], info: &SampleInfo) -> Stored {
        match self.room(payload.len()) {
            Ok(mut slot) => {
                slot.fill(payload, info); // it fits
                self.keep(slot)
            }
            Err(fate) => fate,
        }
    }

    /// A buffer for a sample of `len` bytes, or the fate of a sample that finds none.
    pub(super) fn room(&mut self, len: usize) -> Result<RingSlot, Stored> {
        // Without texts nobody asks.
        if len > self.limit && TEXTS && self.oversizes.add((self.id, len)) {
            return Err(Stored::TooLong);
        }
        let spare = if len > self.limit || self.refuses() {
            None
        } else {
            self.queue.spare()
        };
        spare.ok_or_else(|| self.lose())
    }

    /// Lets a filled buffer wait.
    pub(super) fn keep(&mut self, slot: RingSlot) -> Stored {
        // While one was filled without the lock, another one may have taken the last place.
        if LONG_SAMPLES && self.refuses() {
            self.queue.give_back(slot);
            return self.lose();
        }
        if let Some(oldest) = self.queue.push(slot) {
            self.queue.give_back(oldest);
            self.lost += 1;
        }
        Stored::Waits
    }

    /// Whether a new sample is lost, rather than the oldest.
    fn refuses(&self) -> bool {
        (self.keep_all || self.keep_oldest) && self.queue.is_full()
    }

    const fn lose(&mut self) -> Stored {
        self.lost += 1;
        Stored::Lost
    }
}

pub(super) fn id(index: usize) -> ReaderId {
    ReaderId(u16::try_from(index).unwrap_or(u16::MAX))
}
