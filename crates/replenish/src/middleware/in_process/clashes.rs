//! Which endpoints of one bus do not fit together, and that both ends are told; and how participants are
//! told anything.

use super::{Bus, Clash, ReaderId};
use crate::qos::Qos;
use crate::sync::{Arc, AtomicBool, Mutex, Ordering};
use alloc::collections::VecDeque;
use alloc::vec::Vec;

/// What waits to be told to one participant at most; more is left out.
const LIMIT: usize = 64;

/// What one participant is to be told.
pub(super) struct News<T> {
    any: AtomicBool,
    waiting: Mutex<VecDeque<T>>,
}

/// Of endpoints that do not fit together.
pub(super) type Clashes = News<Clash>;
/// Of samples that are longer than a reader takes, and how long they are.
pub(super) type Oversizes = News<(ReaderId, usize)>;

impl<T> News<T> {
    /// Nothing yet; with `room`, adding allocates nothing.
    pub(super) fn new(room: bool) -> Arc<Self> {
        let waiting = if room { LIMIT } else { 0 };
        Arc::new(Self {
            any: AtomicBool::new(false),
            waiting: Mutex::new(VecDeque::with_capacity(waiting)),
        })
    }

    /// Whether it will be told.
    pub(super) fn add(&self, news: T) -> bool {
        let mut waiting = self.waiting.lock();
        let room = waiting.len() < LIMIT;
        if room {
            waiting.push_back(news);
            self.any.store(true, Ordering::Release);
        }
        room
    }

    pub(super) fn next(&self) -> Option<T> {
        if !self.any.load(Ordering::Acquire) {
            return None;
        }
        let mut waiting = self.waiting.lock();
        let next = waiting.pop_front();
        self.any.store(!waiting.is_empty(), Ordering::Release);
        next
    }
}

impl Bus {
    /// A writer of participant `me` has come. The participants to ring, as bits.
    pub(super) fn compare_writer(&mut self, me: usize, topic: usize, offers: Qos) -> u64 {
        let Some(on) = self.topics.get(topic) else {
            return 0;
        };
        let readers = on.readers.iter().filter_map(|(p, r)| {
            let reader = self.participants.get(*p)?.readers.get(*r)?;
            let clash = offers.check_offers(reader.requests).err()?;
            Some((*p, super::id(*r), clash))
        });
        let found: Vec<_> = readers.collect();
        let mut told = 0;
        for (other, reader, clash) in found {
            told |= self.clash(topic, other, Some(reader), clash);
            told |= self.clash(topic, me, None, clash);
        }
        told
    }

    /// A reader of participant `me` has come. The participants to ring, as bits.
    pub(super) fn compare_reader(
        &mut self,
        me: usize,
        reader: ReaderId,
        topic: usize,
        requests: Qos,
    ) -> u64 {
        let everybody = self.participants.iter().enumerate();
        let writers = everybody.flat_map(|(p, of)| of.writers.iter().map(move |w| (p, w)));
        let mine = writers.filter(|(_, w)| w.topic == topic && !w.deleted);
        let found = mine.filter_map(|(p, w)| Some((p, w.offers.check_offers(requests).err()?)));
        let found: Vec<_> = found.collect();
        let mut told = 0;
        for (other, clash) in found {
            told |= self.clash(topic, me, Some(reader), clash);
            told |= self.clash(topic, other, None, clash);
        }
        told
    }

    fn clash(
        &mut self,
        topic: usize,
        participant: usize,
        reader: Option<ReaderId>,
        clash: crate::QosClash,
    ) -> u64 {
        let Some(topic) = self.topics.get_mut(topic) else {
            return 0;
        };
        topic.clashes = true;
        if let Some(of) = self.participants.get(participant) {
            of.clashes.add(Clash::new(&topic.name, reader, clash));
        }
        1 << participant
    }
}
