//! Samples and their parts come in: which are new, where they are kept, when they are ready.

use super::reader::Reader;
use super::store::{Slot, State};
use crate::wire::{
    Data, DataFrag, Guid, GuidPrefix, INFINITE, Nanos, Payload, SequenceNumber, Timestamp,
    chain_origins, disposed_entity, is_disposal, related_request,
};

impl Reader {
    pub(super) fn find(&self, writer: Guid) -> Option<usize> {
        self.writers.iter().position(|known| known.guid == writer)
    }

    /// A sample from the participant `from`.
    pub fn data(&mut self, from: GuidPrefix, body: &Data<'_>, source: Option<Timestamp>) {
        let guid = Guid::new(from, body.writer);
        let Some(at) = self.find(guid) else {
            return;
        };
        let payload = match body.payload {
            Payload::Data(bytes) | Payload::Key(bytes) => bytes,
            Payload::None => &[],
        };
        let named = || disposed_entity(payload, body.inline_qos).unwrap_or(guid);
        let gone = is_disposal(body.inline_qos).then(named);
        let Some(place) = self.admit(at, body.sn, payload.len()) else {
            return;
        };
        let slot = Slot {
            state: State::Held,
            writer: guid,
            sn: body.sn,
            len: payload.len(),
            source,
            gone,
            related: related_request(body.inline_qos),
            origins: chain_origins(body.inline_qos),
            lifespan: self.lifespan(at),
            ..Slot::default()
        };
        self.store.begin(place, slot);
        self.store.put(place, 0, payload);
        self.complete(at, place, body.sn);
    }

    /// A part of a sample from the participant `from`.
    pub fn data_frag(&mut self, from: GuidPrefix, body: &DataFrag<'_>, source: Option<Timestamp>) {
        let guid = Guid::new(from, body.writer);
        let Some(at) = self.find(guid) else {
            return;
        };
        let len = usize::try_from(body.sample_size).unwrap_or(usize::MAX);
        let total = body
            .sample_size
            .div_ceil(u32::from(body.fragment_size.max(1)));
        let place = match self.store.find(guid, body.sn) {
            Some(place) => place,
            None => {
                let len = if total > self.store.most_fragments() {
                    usize::MAX
                } else {
                    len
                };
                let Some(place) = self.admit(at, body.sn, len) else {
                    return;
                };
                let slot = Slot {
                    state: State::Partial,
                    writer: guid,
                    sn: body.sn,
                    len,
                    source,
                    gone: None,
                    related: related_request(body.inline_qos),
                    origins: chain_origins(body.inline_qos),
                    lifespan: self.lifespan(at),
                    fragment_size: body.fragment_size,
                    missing: total,
                    passed: None,
                    shared: None,
                };
                self.asks_for_references(at);
                self.store.begin(place, slot);
                place
            }
        };
        let Some(slot) = self.store.slots.get(place) else {
            return;
        };
        if slot.state != State::Partial
            || (slot.len, slot.fragment_size) != (len, body.fragment_size)
        {
            return;
        }
        let size = usize::from(body.fragment_size.max(1));
        for (number, bytes) in (body.start..).zip(body.payload.chunks(size)) {
            if self.store.arrive(place, number) {
                let index = usize::try_from(number.saturating_sub(1)).unwrap_or(usize::MAX);
                self.store.put(place, index.saturating_mul(size), bytes);
            }
        }
        if self
            .store
            .slots
            .get(place)
            .is_some_and(|slot| slot.missing == 0)
        {
            self.complete(at, place, body.sn);
        }
    }

    pub(super) fn lifespan(&self, at: usize) -> Nanos {
        self.writers
            .get(at)
            .map_or(INFINITE, |writer| writer.lifespan)
    }

    /// A place for a sample that is new; makes room for it by the reader's history.
    pub(super) fn admit(&mut self, at: usize, sn: SequenceNumber, len: usize) -> Option<usize> {
        let writer = self.writers.get_mut(at)?;
        writer.heard_sample(sn);
        if writer.has(sn) || self.store.find(writer.guid, sn).is_some() {
            self.stats.duplicates += 1;
            return None;
        }
        if !writer.reliable && sn == writer.refused {
            return None;
        }
        if writer.reliable && !writer.in_window(sn) {
            self.stats.refused += 1;
            return None;
        }
        if len > self.store.size() {
            self.stats.too_long += 1;
            self.skip(at, sn);
            return None;
        }
        let place = self.store.free().or_else(|| self.make_room(at, sn));
        self.stats.refused += u64::from(place.is_none());
        place
    }

    /// Marks a sample that will not be taken.
    fn skip(&mut self, at: usize, sn: SequenceNumber) {
        let Some(writer) = self.writers.get_mut(at) else {
            return;
        };
        if writer.reliable {
            writer.mark(sn);
            self.settle(at);
        } else {
            writer.advance(sn.saturating_add(1));
        }
    }

    fn make_room(&mut self, at: usize, sn: SequenceNumber) -> Option<usize> {
        let writer = *self.writers.get(at)?;
        if self.qos.depth != 0 && self.store.ready() > 0 {
            self.stats.overwritten += 1;
            return self.store.take();
        }
        if !writer.reliable {
            return self.displace(writer.guid, sn);
        }
        // No sample can be read: the sample that everything waits for displaces the one that has to
        // wait longest, which its writer sends again.
        if self.store.ready() > 0 || sn != writer.next {
            return None;
        }
        let ahead = |slot: &Slot| {
            let writer = self
                .writers
                .iter()
                .find(|writer| writer.guid == slot.writer);
            writer.map_or(i64::MAX, |writer| slot.sn.saturating_sub(writer.next))
        };
        let slots = self.store.slots.iter().enumerate();
        let waits = |slot: &Slot| !matches!(slot.state, State::Free | State::Fetched);
        let waiting = slots.filter(|(_, slot)| waits(slot));
        let (place, slot) = waiting.max_by_key(|(_, slot)| ahead(slot))?;
        let (guid, sn) = (slot.writer, slot.sn);
        if let Some(writer) = self.find(guid).and_then(|at| self.writers.get_mut(at)) {
            writer.unmark(sn);
        }
        self.store.release(place);
        Some(place)
    }

    /// Room for a sample of a best-effort writer: that of an older one of the same writer, or of
    /// one to which nothing came since the previous sample of this writer was refused. If each
    /// sample displaced those of other writers, those whose fragments come in turn would never be
    /// whole.
    fn displace(&mut self, guid: Guid, sn: SequenceNumber) -> Option<usize> {
        let before = |(of, number): (Guid, SequenceNumber)| of == guid && number < sn;
        let mut parts = self.store.slots.iter_mut().enumerate();
        let found = parts.find_map(|(place, slot)| {
            let id = (slot.writer, slot.sn);
            let gives_way = is_in_parts(slot) && (before(id) || slot.passed.is_some_and(before));
            if !gives_way && slot.writer != guid {
                slot.passed.get_or_insert((guid, sn));
            }
            gives_way.then_some((place, id))
        });
        let (gone, number) = found.map_or((guid, sn), |(_, id)| id);
        if let Some(writer) = self.find(gone).and_then(|at| self.writers.get_mut(at)) {
            writer.refused = number;
        }
        let (place, _) = found?;
        self.store.release(place);
        Some(place)
    }

    /// The sample in `place` is whole.
    pub(super) fn complete(&mut self, at: usize, place: usize, sn: SequenceNumber) {
        let Some(writer) = self.writers.get_mut(at) else {
            return;
        };
        if let Some(slot) = self.store.slots.get_mut(place) {
            slot.state = State::Held;
        }
        if writer.reliable {
            writer.mark(sn);
            self.settle(at);
        } else {
            let guid = writer.guid;
            writer.advance(sn.saturating_add(1));
            self.stats.received += 1;
            self.store.make_ready(place);
            self.drop_older_parts(guid, sn);
        }
    }

    /// Drops parts of older samples of a best-effort writer.
    fn drop_older_parts(&mut self, guid: Guid, sn: SequenceNumber) {
        for slot in &mut self.store.slots {
            if is_in_parts(slot) && slot.writer == guid && slot.sn < sn {
                slot.state = State::Free;
            }
        }
    }

    /// Makes the held samples ready that no missing sample precedes.
    pub(super) fn settle(&mut self, at: usize) {
        let Some(writer) = self.writers.get_mut(at) else {
            return;
        };
        writer.settle();
        let (guid, next) = (writer.guid, writer.next);
        self.release_below(guid, next);
    }

    fn release_below(&mut self, guid: Guid, next: SequenceNumber) {
        loop {
            let slots = self.store.slots.iter().enumerate();
            let held = slots.filter(|(_, slot)| {
                slot.state == State::Held && slot.writer == guid && slot.sn < next
            });
            let Some((place, _)) = held.min_by_key(|(_, slot)| slot.sn) else {
                break;
            };
            self.stats.received += 1;
            self.store.make_ready(place);
        }
    }

    /// Gives up the writer's samples before `to`: the reader waits for none of them any longer.
    pub(super) fn give_up_below(&mut self, at: usize, to: SequenceNumber) -> u64 {
        let Some(writer) = self.writers.get_mut(at) else {
            return 0;
        };
        let missed = writer.advance(to);
        let guid = writer.guid;
        for slot in &mut self.store.slots {
            if is_in_parts(slot) && slot.writer == guid && slot.sn < to {
                slot.state = State::Free;
            }
        }
        self.settle(at);
        missed
    }
}

/// Whether parts of the sample, or all of it, are still at its writer.
fn is_in_parts(slot: &Slot) -> bool {
    matches!(slot.state, State::Partial | State::Referred)
}
