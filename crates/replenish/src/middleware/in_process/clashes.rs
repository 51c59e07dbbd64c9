//! Endpoints of one bus whose QoS are incompatible: both ends get a notice.

use super::bus::{Bus, id};
use crate::middleware::{IncompatibleQos, ReaderId};
use crate::qos::Qos;
use alloc::vec::Vec;

impl Bus {
    /// A writer of participant `me` has come. The participants to ring, as bits.
    pub(super) fn compare_writer(&mut self, me: usize, topic: usize, offers: Qos) -> u64 {
        let Some(on) = self.topics.get(topic) else {
            return 0;
        };
        let readers = on.readers.iter().filter_map(|(p, r)| {
            let reader = self.participant(*p)?.readers.get(*r)?;
            let clash = offers.check_offers(reader.requests).err()?;
            Some((*p, id(*r), clash))
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
        let everybody = self.participants();
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
        let notice = IncompatibleQos::new(&topic.name, reader, clash);
        if let Some(of) = self.participant(participant) {
            of.clashes.add(notice);
        }
        1 << participant
    }
}
