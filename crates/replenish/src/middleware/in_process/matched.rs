//! The peers of an endpoint of a bus: those of its topic whose quality fits. All endpoints.

use super::InProcess;
use super::bus::{Bus, Writer};
use crate::middleware::{GraphEnd, ReaderId, WriterId};
use crate::qos::Qos;

impl Bus {
    pub(super) fn count_readers(&self, me: usize, writer: WriterId) -> Option<usize> {
        let mine = self.participant(me)?;
        let writer = mine.writers.get(usize::from(writer.0))?;
        let readers = self.topics.get(writer.topic)?.readers.iter();
        let fits = readers.filter(|(p, r)| {
            let reader = self.participant(*p).and_then(|p| p.readers.get(*r));
            reader.is_some_and(|reader| writer.offers.check_offers(reader.requests).is_ok())
        });
        Some(fits.count())
    }

    pub(super) fn count_writers(&self, me: usize, reader: ReaderId) -> Option<usize> {
        Some(self.writers_of(me, reader)?.count())
    }

    /// The writers that a reader hears.
    pub(super) fn writers_of(
        &self,
        me: usize,
        reader: ReaderId,
    ) -> Option<impl Iterator<Item = &Writer>> {
        let mine = self.participant(me)?;
        let reader = mine.readers.get(usize::from(reader.0))?;
        let writers = self.participants().flat_map(|(_, p)| &p.writers);
        let fits = writers.filter(move |writer| {
            let of_topic = !writer.deleted && writer.topic == reader.topic;
            of_topic && writer.offers.check_offers(reader.requests).is_ok()
        });
        Some(fits)
    }
}

impl InProcess {
    pub(super) fn every_end(&self, each: &mut dyn FnMut(&GraphEnd<'_>)) {
        let bus = self.bus.state.lock();
        let mut tell = |topic: usize, writes: bool, qos: Qos, node: &str| {
            let Some(topic) = bus.topics.get(topic) else {
                return;
            };
            let requests = topic.name.strip_prefix("rq");
            if requests.is_none() && !topic.name.starts_with('/') {
                return; // replies: their service is known by its requests
            }
            each(&GraphEnd {
                name: requests.unwrap_or(&topic.name),
                type_name: &topic.type_name,
                service: requests.is_some(),
                writes,
                qos,
                node: Some(node),
            });
        };
        for (_, participant) in bus.participants() {
            for writer in participant.writers.iter().filter(|w| !w.deleted) {
                tell(writer.topic, true, writer.offers, &writer.node);
            }
            for reader in participant.readers.iter().filter(|r| !r.deleted) {
                tell(reader.topic, false, reader.requests, &reader.node);
            }
        }
    }
}
