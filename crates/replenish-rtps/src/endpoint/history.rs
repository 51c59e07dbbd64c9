//! [`History`]: the samples that a writer keeps, in memory taken at set-up or with each sample.

use crate::wire::{
    ChainOrigins, Guid, GuidPrefix, Nanos, SampleIdentity, SequenceNumber, SharedPlace, Timestamp,
};
use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;

/// A sample, without its bytes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Change {
    /// 0 is a free place.
    pub(crate) sn: SequenceNumber,
    pub(crate) len: usize,
    pub(crate) source: Option<Timestamp>,
    pub(crate) written: Nanos,
    /// Bytes of a fragment of it.
    pub(crate) fragment: usize,
    /// The instance that this sample disposes of; its bytes are then the key.
    pub(crate) gone: Option<Guid>,
    /// The request that it belongs to.
    pub(crate) related: Option<SampleIdentity>,
    /// The chains that led to it.
    pub(crate) origins: ChainOrigins,
    /// The participant whose readers get it; `None`: all.
    pub(crate) only: Option<GuidPrefix>,
    /// The place in the writer's shared memory that has it, too.
    pub(crate) shared: Option<SharedPlace>,
}

impl Change {
    /// Whether readers of the participant `prefix` get it.
    pub(crate) fn is_for(&self, prefix: GuidPrefix) -> bool {
        self.only.is_none_or(|only| only == prefix)
    }
}

/// The bytes of a sample to be written, with the encapsulation.
#[derive(Debug)]
pub enum Body<'a> {
    /// Parts that are copied, one after another.
    Parts(&'a [&'a [u8]]),
    /// The first bytes of a buffer. If the buffer is exactly as long as the longest sample, nothing
    /// is copied: the writer keeps it and leaves an old one of the same length in its place.
    Buffer(&'a mut Box<[u8]>, usize),
}

impl Body<'_> {
    pub(crate) fn len(&self) -> usize {
        match self {
            Body::Parts(parts) => parts.iter().map(|part| part.len()).sum(),
            Body::Buffer(_, len) => *len,
        }
    }

    /// Moves the bytes into `room`, which is long enough.
    fn put(self, room: &mut Box<[u8]>) {
        match self {
            Body::Parts(parts) => copy(parts, room),
            Body::Buffer(buffer, _) if buffer.len() == room.len() => core::mem::swap(room, buffer),
            Body::Buffer(buffer, len) => copy(&[buffer.get(..len).unwrap_or(&[])], room),
        }
    }
}

fn copy(parts: &[&[u8]], mut room: &mut [u8]) {
    for part in parts {
        let Some((to, rest)) = room.split_at_mut_checked(part.len()) else {
            return;
        };
        replenish_wire::copy(to, part);
        room = rest;
    }
}

/// Places for samples. A sample has the place of its number, counted round; a writer of discovery,
/// which takes samples out of the middle, falls back to any free place.
#[derive(Debug)]
pub(crate) struct History {
    changes: Box<[Change]>,
    /// A buffer for each place.
    bytes: Box<[Box<[u8]>]>,
    size: usize,
    /// Bytes of all samples together where memory is taken with each of them.
    most: Option<usize>,
    used: usize,
    first: SequenceNumber,
    last: SequenceNumber,
}

impl History {
    /// `depth` places of `size` bytes; of as many as a sample has if there is a bound for `most`
    /// bytes of all samples.
    pub(crate) fn new(depth: usize, size: usize, most: Option<usize>) -> Self {
        let depth = depth.max(1);
        let room = if most.is_some() { 0 } else { size };
        History {
            changes: vec![Change::default(); depth].into_boxed_slice(),
            bytes: (0..depth).map(|_| buffer(room)).collect::<Vec<_>>().into(),
            size,
            most: most.map(|most| most.max(size)),
            used: 0,
            first: 1,
            last: 0,
        }
    }

    /// The first sample that is kept; one after the last if there is none.
    pub(crate) const fn first(&self) -> SequenceNumber {
        self.first
    }

    /// The last number that was given; 0 before the first.
    pub(crate) const fn last(&self) -> SequenceNumber {
        self.last
    }

    /// Bytes of the longest sample.
    pub(crate) const fn size(&self) -> usize {
        self.size
    }

    fn home(&self, sn: SequenceNumber) -> usize {
        let depth = i64::try_from(self.changes.len()).unwrap_or(i64::MAX);
        usize::try_from(sn.rem_euclid(depth)).unwrap_or(0)
    }

    fn place(&self, sn: SequenceNumber) -> Option<usize> {
        let home = self.home(sn);
        if self.changes.get(home).is_some_and(|change| change.sn == sn) {
            return Some(home);
        }
        self.changes.iter().position(|change| change.sn == sn)
    }

    /// The sample and its bytes.
    pub(crate) fn get(&self, sn: SequenceNumber) -> Option<(&Change, &[u8])> {
        if !(self.first..=self.last).contains(&sn) {
            return None;
        }
        let place = self.place(sn)?;
        let change = self.changes.get(place)?;
        let bytes = self.bytes.get(place)?.get(..change.len)?;
        Some((change, bytes))
    }

    /// Whether the sample is kept, and for readers of the participant `prefix`.
    pub(crate) fn has_for(&self, sn: SequenceNumber, prefix: GuidPrefix) -> bool {
        self.get(sn)
            .is_some_and(|(change, _)| change.is_for(prefix))
    }

    /// The first of the newest samples, each of which has an addressee, that is for `prefix` alone.
    pub(crate) fn first_addressed(&self, prefix: GuidPrefix) -> Option<SequenceNumber> {
        let newest = (self.first..=self.last).rev();
        let only = |sn| Some((sn, self.get(sn)?.0.only?));
        let addressed = newest.map_while(only).filter(|(_, only)| *only == prefix);
        addressed.last().map(|(sn, _)| sn)
    }

    /// Whether a sample must go before one of `len` bytes can be kept.
    pub(crate) fn is_full_for(&self, len: usize) -> bool {
        let over = |most| self.used > 0 && self.used.saturating_add(len) > most;
        self.most.is_some_and(over) || self.is_full()
    }

    /// Whether a sample must go before the next one can be kept.
    pub(crate) fn is_full(&self) -> bool {
        let next = self.home(self.last.saturating_add(1));
        let free = |change: &Change| change.sn == 0;
        !self.changes.get(next).is_some_and(free) && !self.changes.iter().any(free)
    }

    /// Keeps a sample that is at most [`History::size`] long; the first one goes if there is no
    /// place. Returns its number.
    pub(crate) fn add(&mut self, mut change: Change, body: Body<'_>) -> SequenceNumber {
        while self.first <= self.last && self.is_full_for(body.len()) {
            self.remove(self.first);
        }
        let sn = self.last.saturating_add(1);
        let home = self.home(sn);
        let free = |change: &Change| change.sn == 0;
        let place = if self.changes.get(home).is_some_and(free) {
            home
        } else {
            self.changes.iter().position(free).unwrap_or(home)
        };
        change.sn = sn;
        change.len = body.len().min(self.size);
        if let Some(room) = self.bytes.get_mut(place) {
            if self.most.is_some() {
                *room = buffer(change.len);
                self.used = self.used.saturating_add(change.len);
            }
            body.put(room);
        }
        if let Some(slot) = self.changes.get_mut(place) {
            *slot = change;
        }
        self.last = sn;
        sn
    }

    /// Forgets a sample.
    pub(crate) fn remove(&mut self, sn: SequenceNumber) {
        let place = self.place(sn);
        if sn == 0 {
            return;
        }
        let change = place.and_then(|place| self.changes.get_mut(place));
        if let (Some(change), Some(place)) = (change, place) {
            change.sn = 0;
            if let Some(room) = self.bytes.get_mut(place).filter(|_| self.most.is_some()) {
                self.used = self.used.saturating_sub(change.len);
                *room = Box::default();
            }
        }
        if sn == self.first {
            self.find_first();
        }
    }

    /// The first sample that says that an instance is gone.
    pub(crate) fn first_disposal(&self) -> Option<SequenceNumber> {
        let kept = self.changes.iter().filter(|change| change.sn != 0);
        let disposals = kept.filter(|change| change.gone.is_some());
        disposals.map(|change| change.sn).min()
    }

    fn find_first(&mut self) {
        let next = self.first.saturating_add(1);
        self.first = if self.place_at_home(next) {
            next
        } else {
            let kept = self.changes.iter().map(|change| change.sn);
            let first = kept.filter(|sn| *sn > 0).min();
            first.unwrap_or_else(|| self.last.saturating_add(1))
        };
    }

    fn place_at_home(&self, sn: SequenceNumber) -> bool {
        let change = self.changes.get(self.home(sn));
        change.is_some_and(|change| change.sn == sn)
    }
}

fn buffer(size: usize) -> Box<[u8]> {
    vec![0; size].into_boxed_slice()
}
