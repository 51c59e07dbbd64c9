//! Endpoints of one bus that meet: both ends count it, and get a notice if their QoS are
//! incompatible.

use super::bus::{Bus, id};
use crate::middleware::watch::EndStatus;
use crate::middleware::{IncompatibleQos, ReaderId};
use crate::qos::Qos;
use alloc::vec::Vec;

impl Bus {
    /// A writer of participant `me` has come; it has met `status`. The participants to ring, as
    /// bits.
    pub(super) fn compare_writer(
        &mut self,
        me: usize,
        topic: usize,
        offers: Qos,
        status: &mut EndStatus,
    ) -> u64 {
        let Some(on) = self.topics.get(topic) else {
            return 0;
        };
        let readers = on.readers.iter().filter_map(|(p, r)| {
            let reader = self.participant(*p)?.readers.get(*r)?;
            Some((*p, id(*r), offers.check_offers(reader.requests)))
        });
        let found: Vec<_> = readers.collect();
        let mut told = self.watchers();
        for (other, reader, fit) in found {
            status.met(fit.as_ref().copied());
            if let Some(end) = self.reader_status(other, reader) {
                end.met(fit.as_ref().copied());
            }
            if let Err(clash) = fit {
                told |= self.clash(topic, other, Some(reader), clash);
                told |= self.clash(topic, me, None, clash);
            }
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
        let everybody = self.participants_mut();
        let writers = everybody.flat_map(|(p, of)| of.writers.iter_mut().map(move |w| (p, w)));
        let mine = writers.filter(|(_, w)| w.topic == topic && !w.deleted);
        let found = mine.map(|(p, writer)| {
            let fit = writer.offers.check_offers(requests);
            writer.status.met(fit.as_ref().copied());
            (p, fit)
        });
        let found: Vec<_> = found.collect();
        let mut told = self.watchers();
        for (other, fit) in found {
            if let Some(end) = self.reader_status(me, reader) {
                end.met(fit.as_ref().copied());
            }
            if let Err(clash) = fit {
                told |= self.clash(topic, me, Some(reader), clash);
                told |= self.clash(topic, other, None, clash);
            }
        }
        told
    }

    fn reader_status(&mut self, participant: usize, reader: ReaderId) -> Option<&mut EndStatus> {
        let readers = &mut self.participant_mut(participant)?.readers;
        Some(&mut readers.get_mut(usize::from(reader.0))?.status)
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
