//! Repair of a reader's losses: heartbeats and gaps come in, ACKNACK and `NACK_FRAG` go out.

use super::peer_writer::{PeerWriter, WINDOW};
use super::reader::Reader;
use super::store::Store;
use crate::wire::{
    AckNack, Bits, Gap, Guid, GuidPrefix, Heartbeat, INFINITE, MessageWriter, NackFrag, Nanos,
    SequenceNumber, SequenceSet,
};
use core::net::SocketAddr;

/// The vendor id with which prefixes of Fast DDS begin (RTPS 2.5, 9.3.1.5). Its writers answer an
/// ACKNACK that asks for a heartbeat at once if it begins at 0, as that of its own readers does,
/// and otherwise with the next periodic heartbeat, after up to 3 s.
const EPROSIMA: [u8; 2] = [0x01, 0x0f];

/// Nanoseconds until a writer that was not heard yet is asked for a heartbeat again.
const ASK_AGAIN: Nanos = 1_000_000_000;

impl Reader {
    /// A heartbeat from the participant `from`, which is answered at once, or as soon as the writer
    /// may be asked again.
    pub fn heartbeat(&mut self, from: GuidPrefix, body: &Heartbeat) {
        self.heartbeat_until(from, body, 0);
    }

    /// A heartbeat that is to be answered until `answer_at`, or earlier if a sample is missing.
    pub(crate) fn heartbeat_until(&mut self, from: GuidPrefix, body: &Heartbeat, answer_at: Nanos) {
        let Some(at) = self.find(Guid::new(from, body.writer)) else {
            return;
        };
        let Some(writer) = self.writers.get_mut(at).filter(|writer| writer.reliable) else {
            return;
        };
        let new = |last: u32| body.count.wrapping_sub(last).cast_signed() > 0;
        if !writer.heartbeat_count.is_none_or(new) {
            return;
        }
        writer.heartbeat_count = Some(body.count);
        if !body.final_flag {
            writer.compare(body.last);
        }
        let promised = writer.heard_heartbeat(body.first, body.last);
        let waits = if writer.reveals { promised } else { body.first };
        self.give_up_below(at, promised.min(waits));
        let lost = self.give_up_below(at, body.first);
        self.stats.lost = self.stats.lost.saturating_add(lost); // both ends are the peer's to choose
        if let Some(writer) = self.writers.get_mut(at) {
            if writer.lacks() {
                (writer.ack, writer.ack_at) = (true, writer.asked.again_at(writer.next));
            } else if !body.final_flag {
                let before = if writer.ack { writer.ack_at } else { INFINITE };
                (writer.ack, writer.ack_at) = (true, before.min(answer_at));
            }
        }
    }

    /// A gap from the participant `from`.
    pub fn gap(&mut self, from: GuidPrefix, body: &Gap) {
        let Some(at) = self.find(Guid::new(from, body.writer)) else {
            return;
        };
        let Some(writer) = self.writers.get_mut(at).filter(|writer| writer.reliable) else {
            return;
        };
        writer.unheard = false;
        if body.start <= writer.next {
            self.give_up_below(at, body.list.base);
        } else {
            let end = writer.next.saturating_add(WINDOW);
            for sn in body.start..body.list.base.min(end) {
                self.cross_out(at, sn);
            }
        }
        for sn in body.list.iter() {
            self.cross_out(at, sn);
        }
        self.settle(at);
    }

    fn cross_out(&mut self, at: usize, sn: SequenceNumber) {
        let Some(writer) = self.writers.get_mut(at) else {
            return;
        };
        if writer.has(sn) {
            return;
        }
        writer.mark(sn);
        let guid = writer.guid;
        if let Some(place) = self.store.find(guid, sn) {
            self.store.release(place);
        }
    }

    /// Whether [`Reader::transmit`] has something to say.
    #[must_use]
    pub fn wants_to_transmit(&self, now: Nanos) -> bool {
        self.answers_at() <= now
    }

    /// Fills `m`, which has no submessages yet, with an answer to one writer, and says where to
    /// send it.
    pub fn transmit(&mut self, now: Nanos, m: &mut MessageWriter<'_>) -> Option<SocketAddr> {
        let count = self.writers.len();
        let at = (0..count)
            .filter_map(|step| self.next_writer.saturating_add(step).checked_rem(count))
            .find(|at| {
                let writer = self.writers.get(*at);
                writer.is_some_and(|writer| writer.answers_at() <= now)
            })?;
        self.next_writer = at.saturating_add(1);
        let writer = self.writers.get_mut(at)?;
        let (to, prefix) = (writer.to, writer.guid.prefix);
        m.info_destination(prefix).ok()?;
        self.answer(at, now, m)?;
        Some(to)
    }

    /// Adds the answer to one writer; `None` if it does not fit.
    pub(super) fn answer(
        &mut self,
        at: usize,
        now: Nanos,
        m: &mut MessageWriter<'_>,
    ) -> Option<()> {
        let (reader, store) = (self.guid.entity, &self.store);
        let writer = self.writers.get_mut(at)?;
        if let Some(taken) = writer.say() {
            m.shared(reader, writer.guid.entity, taken).ok()?;
        }
        if !writer.ack || (writer.waits_to_ask() && now < writer.ack_at) {
            return Some(());
        }
        if writer.lacks() {
            writer.asked.note(first_missing(store, writer), now);
        }
        let mut state = SequenceSet::empty(writer.next);
        let mut part = None;
        let end = writer.next.saturating_add(i64::from(Bits::MAX));
        for sn in writer.next..end.min(writer.last.saturating_add(1)) {
            if writer.has(sn) {
                continue;
            }
            // Of a sample in parts, the reader requests only the missing parts.
            match store.find(writer.guid, sn) {
                Some(place) if store.is_partial(place) => part = part.or(Some((sn, place))),
                Some(_) => {}
                None => {
                    state.insert(sn);
                }
            }
        }
        if writer.unheard && writer.guid.prefix.0.starts_with(&EPROSIMA) {
            state = SequenceSet::empty(0);
        }
        self.ack_count = self.ack_count.wrapping_add(1);
        let body = AckNack {
            reader,
            writer: writer.guid.entity,
            state,
            count: self.ack_count,
            final_flag: !writer.unheard,
        };
        m.acknack(&body).ok()?;
        // One that was not heard is asked again: this may get lost.
        writer.ack = writer.unheard;
        writer.ack_at = now.saturating_add(ASK_AGAIN);
        let part = part
            .and_then(|(sn, place)| Some((sn, store.missing(place, writer.asked.most.into())?)));
        if let Some((sn, state)) = part {
            writer.asked.fragments = state.bits.count();
            self.nack_frag_count = self.nack_frag_count.wrapping_add(1);
            let body = NackFrag {
                reader,
                writer: writer.guid.entity,
                sn,
                state,
                count: self.nack_frag_count,
            };
            m.nack_frag(&body).ok()?;
        }
        Some(())
    }
}

/// The first sample that is missing, and its first fragment, from 1; 0 if nothing of it has come.
fn first_missing(store: &Store, writer: &PeerWriter) -> (SequenceNumber, u32) {
    let sn = writer.next;
    let place = store.find(writer.guid, sn);
    let part = place.filter(|place| store.is_partial(*place));
    let missing = part.and_then(|place| store.missing(place, 1));
    (sn, missing.map_or(0, |missing| missing.base))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::endpoint::ReaderLimits;
    use crate::wire::{EntityId, Message, Qos, Submessage};
    use core::net::Ipv4Addr;

    /// The set with which a reader asks a new writer for a heartbeat, and whether it asks.
    fn asks(writer: GuidPrefix, heard: bool) -> Option<(SequenceNumber, bool)> {
        let limits = ReaderLimits {
            samples: 1,
            sample_bytes: 8,
            writers: 1,
        };
        let own = Guid::new(GuidPrefix([7; 12]), EntityId::reader(1));
        let mut reader = Reader::new(own, Qos::latched(1), &limits);
        let writer = Guid::new(writer, EntityId::writer(1));
        reader.add_writer(writer, &Qos::latched(1), (Ipv4Addr::LOCALHOST, 1).into());
        let heartbeat = Heartbeat {
            reader: own.entity,
            writer: writer.entity,
            first: 5,
            last: 5,
            count: 1,
            final_flag: false,
            liveliness: false,
        };
        if heard {
            reader.heartbeat(writer.prefix, &heartbeat);
        }
        let mut buf = [0; 256];
        let mut m = MessageWriter::new(&mut buf, own.prefix).ok()?;
        reader.transmit(0, &mut m)?;
        let bytes = m.message();
        let mut parts = Message::decode(bytes).ok()?.submessages();
        parts.find_map(|part| match part.ok()? {
            Submessage::AckNack(body) => Some((body.state.base, !body.final_flag)),
            _ => None,
        })
    }

    #[test]
    fn a_writer_of_fast_dds_is_asked_for_a_heartbeat_as_its_own_readers_ask() {
        let fast_dds = GuidPrefix([1, 15, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
        let cyclone = GuidPrefix([1, 16, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
        assert_eq!(asks(fast_dds, false), Some((0, true)));
        assert_eq!(asks(cyclone, false), Some((1, true)));
        for writer in [fast_dds, cyclone] {
            assert_eq!(asks(writer, true), Some((5, false)));
        }
    }
}
