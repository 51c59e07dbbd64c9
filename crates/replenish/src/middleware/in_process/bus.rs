//! What the lock of a bus protects: topics, participants, and how a sample gets into the queues of
//! its readers.

use super::notices::{Clashes, Oversizes};
use crate::handoff::{Ring, SampleInfo};
use crate::middleware::{EndpointSpec, Interest, MiddlewareError, ReaderId};
use crate::platform::{TEXTS, label};
use crate::qos::Qos;
use crate::sync::{Arc, Notify};
use alloc::string::String;
use alloc::vec::Vec;
use replenish_os::clock;

/// The most participants of one bus.
const MAX_PARTICIPANTS: usize = 64;

#[derive(Default)]
pub(super) struct Bus {
    pub(super) topics: Vec<Topic>,
    pub(super) participants: Vec<Participant>,
}

pub(super) struct Topic {
    pub(super) name: String,
    pub(super) type_name: String,
    /// Participant and reader of each subscription.
    pub(super) readers: Vec<(usize, usize)>,
    /// Some writer and some reader do not fit together.
    pub(super) clashes: bool,
}

pub(super) struct Participant {
    pub(super) bell: Arc<Notify>,
    /// What its dispatcher waits for at this moment.
    pub(super) waits_for: Option<Interest>,
    /// Where the next `take` starts to look, so that no reader starves the others.
    pub(super) next: usize,
    pub(super) readers: Vec<Reader>,
    pub(super) writers: Vec<Writer>,
    /// What does not fit together, and was not told yet.
    pub(super) clashes: Arc<Clashes>,
}

pub(super) struct Writer {
    pub(super) topic: usize,
    pub(super) offers: Qos,
    /// The largest payload it may send.
    pub(super) limit: usize,
    /// Samples sent so far.
    pub(super) sent: u64,
    /// A client's reader of replies.
    pub(super) replies: Option<usize>,
    /// The latest samples, for readers that come late (transient local).
    pub(super) kept: Option<Ring>,
    /// It was deleted; its place is free.
    pub(super) deleted: bool,
}

pub(super) struct Reader {
    pub(super) id: ReaderId,
    pub(super) requests: Qos,
    /// The largest sample it takes.
    pub(super) limit: usize,
    pub(super) oversizes: Arc<Oversizes>,
    pub(super) queue: Ring,
    pub(super) keep_all: bool,
    pub(super) keep_oldest: bool,
    pub(super) reliable: bool,
    pub(super) lost: u64,
    /// It was deleted; its place is free.
    pub(super) deleted: bool,
    /// How many readers have had this place before.
    pub(super) generation: u32,
}

impl Bus {
    pub(super) fn topic(&mut self, spec: &EndpointSpec<'_>) -> Result<usize, MiddlewareError> {
        if let Some(at) = self.topics.iter().position(|t| t.name == spec.topic) {
            let existing = &self.topics.get(at).map(|t| t.type_name.clone());
            return match existing {
                Some(name) if name != spec.type_name => Err(MiddlewareError::TypeMismatch {
                    existing: name.as_str().into(),
                }),
                _ => Ok(at),
            };
        }
        self.topics.push(Topic {
            name: spec.topic.into(),
            type_name: spec.type_name.into(),
            readers: Vec::new(),
            clashes: false,
        });
        Ok(self.topics.len() - 1)
    }

    pub(super) fn me(&mut self, me: usize) -> Result<&mut Participant, MiddlewareError> {
        let too_many = MiddlewareError::Capacity {
            what: label("participants of one in-process bus"),
            limit: MAX_PARTICIPANTS,
        };
        let known = self.participants.get_mut(me);
        known.filter(|_| me < MAX_PARTICIPANTS).ok_or(too_many)
    }

    /// Gives a reader that comes late what the topic's writers have kept.
    pub(super) fn catch_up(&self, topic: usize, reader: &mut Reader) {
        let writers = self.participants.iter().flat_map(|p| &p.writers);
        let requests = reader.requests;
        let fits = |w: &&Writer| w.offers.check_offers(requests).is_ok();
        let mine = writers.filter(|w| w.topic == topic && !w.deleted && fits(w));
        for sample in mine.filter_map(|w| w.kept.as_ref()).flat_map(Ring::waiting) {
            let arrival = clock::monotonic();
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
            let Some(participant) = self.participants.get_mut(p) else {
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
                    let waits = participant.waits_for.as_ref();
                    if waits.is_some_and(|i| i.contains(id(r))) {
                        participant.waits_for = None; // one bell is enough
                        wake |= 1 << p;
                    }
                }
                Stored::TooLong => wake |= 1 << p,
                Stored::Lost => full |= reader.reliable && reader.keep_all,
            }
        }
        (wake, full)
    }
}

/// What has become of a sample for one reader.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Stored {
    Waits,
    Lost,
    /// Its participant is to be told.
    TooLong,
}

impl Reader {
    /// Anything that did not find room is counted, or told.
    pub(super) fn store(&mut self, payload: &[u8], info: &SampleInfo) -> Stored {
        if payload.len() > self.limit {
            // Without texts nobody asks.
            if TEXTS && self.oversizes.add((self.id, payload.len())) {
                return Stored::TooLong;
            }
            self.lost += 1;
            return Stored::Lost;
        }
        if (self.keep_all || self.keep_oldest) && self.queue.is_full() {
            self.lost += 1;
            return Stored::Lost;
        }
        let Some(mut slot) = self.queue.spare() else {
            self.lost += 1;
            return Stored::Lost;
        };
        slot.fill(payload, info); // it fits
        if let Some(oldest) = self.queue.push(slot) {
            self.queue.give_back(oldest);
            self.lost += 1;
        }
        Stored::Waits
    }
}

pub(super) fn id(index: usize) -> ReaderId {
    ReaderId(u16::try_from(index).unwrap_or(u16::MAX))
}
