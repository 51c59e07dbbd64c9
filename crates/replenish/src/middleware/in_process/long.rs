//! Long samples: copied reader by reader, without the lock of the bus.
//!
//! ```text
//!   lock: a buffer of the next reader ─ unlock ─ copy ─ lock: the reader keeps it ─ unlock ─ ring
//! ```
//!
//! So whoever publishes a short sample meanwhile waits for no copy of a long one. Readers are
//! visited by their stamps: one that goes meanwhile is left out, and none is visited twice.

use super::InProcess;
use super::bus::{Bus, Stored, id};
use super::in_memory::Bells;
use crate::handoff::{Ring, RingSlot, Shared};
use crate::middleware::{PublishError, WriterId};
use crate::qos::Qos;
use replenish_os::clock;

/// A reader of a topic.
#[derive(Clone, Copy)]
struct Place {
    participant: usize,
    reader: usize,
    stamp: u32,
}

impl InProcess {
    /// [`publish`](crate::middleware::Middleware::publish) of a long sample. If it is in memory,
    /// too, readers that take it as it is get no bytes.
    pub(super) fn publish_long(
        &self,
        writer: WriterId,
        payload: &[u8],
        message: Option<&Shared>,
    ) -> Result<(), PublishError> {
        let mut bells = Bells::default();
        let (topic, info, kept, told, share) = {
            let mut bus = self.bus.state.lock();
            let (writer, info) = bus.begin(self.me, writer, payload.len())?;
            let begins = writer.renew(info.arrival);
            let spare = writer.kept.as_mut().and_then(Ring::spare);
            let from = (writer.topic, writer.offers, writer.wrote_bytes);
            writer.wrote_bytes = true;
            let mut told = if begins { bus.watchers() } else { 0 };
            let share = message.map(|message| {
                told |= bus.share(from, message, &info, &mut bells);
                bus.shares
            });
            ((from.0, from.1), info, spare, told, share)
        };
        bells.ring(info.arrival);
        self.bus.ring(told);
        let kept = kept.map(|mut slot| {
            slot.fill(payload, &info);
            slot
        });
        // A reader that comes later gets the sample from what its writer keeps.
        let newest = self.keep_for_late(writer, kept);
        let (mut last, mut full) = (None, false);
        while let Some((place, room)) = self.next_room(topic, (newest, last, share), payload.len())
        {
            last = Some(place);
            let fate = room.map(|mut slot| {
                slot.fill(payload, &info); // it fits
                self.put(place, slot)
            });
            let (fate, keeps_all) = fate.unwrap_or_else(|fate| fate);
            full |= fate == Stored::Lost && keeps_all;
            self.notify(place, fate);
        }
        if full {
            Err(PublishError::Full)
        } else {
            Ok(())
        }
    }

    /// Lets the writer keep a sample; the stamp of the newest reader at that moment.
    fn keep_for_late(&self, writer: WriterId, slot: Option<RingSlot>) -> u32 {
        let mut bus = self.bus.state.lock();
        let mine = bus.participant_mut(self.me);
        let writer = mine.and_then(|p| p.writers.get_mut(usize::from(writer.0)));
        let kept = writer.and_then(|writer| writer.kept.as_mut());
        if let (Some(kept), Some(slot)) = (kept, slot)
            && let Some(oldest) = kept.push(slot)
        {
            kept.give_back(oldest);
        }
        bus.stamp
    }

    /// The next reader after `last`, and a buffer of it, or why it has none and whether that is an
    /// error of the publisher's.
    #[expect(clippy::type_complexity, reason = "one caller, above")]
    fn next_room(
        &self,
        topic: (usize, Qos),
        from: (u32, Option<Place>, Option<u64>),
        len: usize,
    ) -> Option<(Place, Result<RingSlot, (Stored, bool)>)> {
        let mut bus = self.bus.state.lock();
        let place = bus.next_reader(topic, from)?;
        let participant = bus.participant_mut(place.participant)?;
        let reader = participant.readers.get_mut(place.reader)?;
        let keeps_all = reader.reliable && reader.keep_all;
        let room = reader.room(len).map_err(|fate| (fate, keeps_all));
        Some((place, room))
    }

    /// Gives a filled buffer to the reader that it belongs to.
    fn put(&self, place: Place, slot: RingSlot) -> (Stored, bool) {
        let kept = {
            let mut bus = self.bus.state.lock();
            let participant = bus.participant_mut(place.participant);
            let reader = participant.and_then(|p| p.readers.get_mut(place.reader));
            match reader.filter(|r| !r.deleted && r.stamp == place.stamp) {
                Some(reader) => Ok((reader.keep(slot), reader.reliable && reader.keep_all)),
                None => Err(slot),
            }
        };
        // The reader has gone: its buffer is freed without the lock.
        kept.unwrap_or((Stored::Lost, false))
    }

    /// Wakes the reader's participant, if it waits for the sample or is to be told of it.
    fn notify(&self, place: Place, fate: Stored) {
        let mut bus = self.bus.state.lock();
        let Some(participant) = bus.participant_mut(place.participant) else {
            return;
        };
        if fate == Stored::Waits
            && let Some(reader) = participant.readers.get_mut(place.reader)
        {
            reader.deadline.renew(clock::monotonic());
        }
        let waits = participant.waits_for.as_ref();
        let waits = waits.is_some_and(|interest| interest.contains(id(place.reader)));
        let wake = fate == Stored::TooLong || (fate == Stored::Waits && waits);
        if wake && fate == Stored::Waits {
            participant.waits_for = None; // one bell is enough
        }
        drop(bus);
        if wake {
            self.bus.ring(1 << place.participant);
        }
    }
}

impl Bus {
    /// The oldest reader of the topic after `last` and up to the stamp `newest`. A reader that has
    /// got the message `share` as it is is left out.
    fn next_reader(
        &self,
        (topic, offers): (usize, Qos),
        (newest, last, share): (u32, Option<Place>, Option<u64>),
    ) -> Option<Place> {
        /// Older than any reader; readers that came after `newest` are beyond it.
        const OLDEST: u32 = 1 << 31;
        let age = |stamp: u32| newest.wrapping_sub(stamp);
        let bound = last.map_or(OLDEST, |place| age(place.stamp));
        let topic = self.topics.get(topic)?;
        let places = topic.readers.iter().filter_map(|&(participant, reader)| {
            let found = self.participant(participant)?.readers.get(reader)?;
            let fits = !topic.clashes || offers.check_offers(found.requests).is_ok();
            let fits = fits && share != Some(found.last_share);
            let place = Place {
                participant,
                reader,
                stamp: found.stamp,
            };
            Some(place).filter(|place| fits && age(place.stamp) < bound)
        });
        places.max_by_key(|place| age(place.stamp))
    }
}
