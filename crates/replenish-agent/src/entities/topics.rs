//! The writers and readers of each topic: topics by domain, name and type.

use super::qos::Qos;
use crate::flow::shrink;
use std::collections::HashMap;
use std::sync::Arc;

/// The identity of a topic: endpoints with the same key talk to each other.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct TopicKey {
    pub(crate) domain: i16,
    pub(crate) name: Arc<str>,
    pub(crate) type_name: Arc<str>,
}

/// A topic in a [`Topics`] table, valid while it is attached to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TopicId(usize);

/// End of a topic: writer or reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum End {
    Writer,
    Reader,
}

/// Bytes for each entity in the tables, which keep them when it is gone: a requester or replier has
/// two topics, each with a place, which may be free, and tables are up to twice as long as needed.
pub(crate) const TOPIC_BYTES: usize = 2 * 2 * 2 * size_of::<usize>();

/// An endpoint of a topic; `A` is its address.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TopicEndpoint<A> {
    pub(crate) address: A,
    pub(crate) qos: Qos,
}

/// The topics that have a writer or a reader. Bounded by the number of entities of all clients.
#[derive(Debug)]
pub(crate) struct Topics<A> {
    ids: HashMap<TopicKey, usize>,
    slots: Vec<Option<Box<TopicSlot<A>>>>,
    free: Vec<usize>,
}

#[derive(Debug)]
struct TopicSlot<A> {
    key: TopicKey,
    writers: Vec<TopicEndpoint<A>>,
    readers: Vec<TopicEndpoint<A>>,
}

impl<A: Copy + PartialEq> Topics<A> {
    pub(crate) fn new() -> Self {
        Self {
            ids: HashMap::new(),
            slots: Vec::new(),
            free: Vec::new(),
        }
    }

    /// Attaches an endpoint; the topic comes into being if need be. Returns it, and with how many
    /// of those at the other end this one does not talk because of its QoS.
    pub(crate) fn attach(
        &mut self,
        key: &TopicKey,
        end: End,
        endpoint: TopicEndpoint<A>,
    ) -> (TopicId, usize) {
        let id = match self.ids.get(key) {
            Some(&id) => id,
            None => self.insert(key.clone()),
        };
        let Some(slot) = self.slots.get_mut(id).and_then(Option::as_mut) else {
            return (TopicId(id), 0);
        };
        let mismatches = match end {
            End::Writer => {
                slot.writers.push(endpoint);
                let readers = slot.readers.iter();
                readers.filter(|r| !endpoint.qos.serves(&r.qos)).count()
            }
            End::Reader => {
                slot.readers.push(endpoint);
                let writers = slot.writers.iter();
                writers.filter(|w| !w.qos.serves(&endpoint.qos)).count()
            }
        };
        (TopicId(id), mismatches)
    }

    /// Detaches what [`attach`](Self::attach) attached; the last one ends the topic.
    pub(crate) fn detach(&mut self, TopicId(id): TopicId, end: End, address: A) {
        let Some(place) = self.slots.get_mut(id) else {
            return;
        };
        let Some(slot) = place else {
            return;
        };
        let list = match end {
            End::Writer => &mut slot.writers,
            End::Reader => &mut slot.readers,
        };
        shrink::retain(list, |endpoint| endpoint.address != address);
        if slot.writers.is_empty()
            && slot.readers.is_empty()
            && let Some(slot) = place.take()
        {
            shrink::remove(&mut self.ids, &slot.key);
            self.free.push(id);
        }
    }

    fn slot(&self, id: usize) -> Option<&TopicSlot<A>> {
        self.slots.get(id)?.as_deref()
    }

    /// The readers of a topic, in the order in which they came.
    pub(crate) fn readers(&self, TopicId(id): TopicId) -> &[TopicEndpoint<A>] {
        self.slot(id).map_or(&[], |slot| &slot.readers)
    }

    /// The writers of a topic, in the order in which they came.
    pub(crate) fn writers(&self, TopicId(id): TopicId) -> &[TopicEndpoint<A>] {
        self.slot(id).map_or(&[], |slot| &slot.writers)
    }

    /// The number of topics.
    pub(crate) fn len(&self) -> usize {
        self.ids.len()
    }

    fn insert(&mut self, key: TopicKey) -> usize {
        let slot = Some(Box::new(TopicSlot {
            key: key.clone(),
            writers: Vec::new(),
            readers: Vec::new(),
        }));
        let id = match self.free.pop() {
            Some(id) => id,
            None => self.slots.len(),
        };
        match self.slots.get_mut(id) {
            Some(free) => *free = slot,
            None => self.slots.push(slot),
        }
        self.ids.insert(key, id);
        id
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Limits;

    fn key(domain: i16, name: &str, type_name: &str) -> TopicKey {
        TopicKey {
            domain,
            name: name.into(),
            type_name: type_name.into(),
        }
    }

    fn at(address: i32) -> TopicEndpoint<i32> {
        let qos = Qos::reader(&Limits::DEFAULT);
        TopicEndpoint { address, qos }
    }

    fn addresses(list: &[TopicEndpoint<i32>]) -> Vec<i32> {
        list.iter().map(|endpoint| endpoint.address).collect()
    }

    #[test]
    fn domain_name_and_type_must_agree() {
        let mut topics = Topics::new();
        let (topic, _) = topics.attach(&key(0, "t", "A"), End::Writer, at(0));
        for (number, key) in [
            (1, key(0, "t", "A")),
            (2, key(1, "t", "A")),
            (3, key(0, "u", "A")),
            (4, key(0, "t", "B")),
            (5, key(0, "t", "A")),
        ] {
            topics.attach(&key, End::Reader, at(number));
        }
        assert_eq!(addresses(topics.readers(topic)), [1, 5]);
        assert_eq!(addresses(topics.writers(topic)), [0]);
        assert_eq!(topics.len(), 4);
    }

    #[test]
    fn a_topic_ends_with_its_last_endpoint_and_its_slot_is_used_again() {
        let mut topics = Topics::new();
        let (a, _) = topics.attach(&key(0, "a", "T"), End::Writer, at(7));
        let (same, _) = topics.attach(&key(0, "a", "T"), End::Reader, at(7));
        assert_eq!(a, same);
        topics.detach(a, End::Writer, 7);
        assert_eq!(addresses(topics.readers(a)), [7]);
        topics.detach(a, End::Reader, 7);
        let (b, _) = topics.attach(&key(0, "b", "T"), End::Writer, at(8));
        assert_eq!(a, b, "the free slot");
        assert!(topics.readers(b).is_empty());
        assert_eq!(topics.len(), 1);
    }

    #[test]
    fn mismatches_are_told_to_the_second_of_a_pair() {
        let mut topics = Topics::new();
        let reliable = |address| TopicEndpoint {
            address,
            qos: Qos::writer(),
        };
        let key = key(0, "t", "T");
        assert_eq!(topics.attach(&key, End::Writer, at(1)).1, 0);
        assert_eq!(topics.attach(&key, End::Reader, reliable(2)).1, 1);
        assert_eq!(topics.attach(&key, End::Writer, reliable(3)).1, 0);
        assert_eq!(topics.attach(&key, End::Writer, at(4)).1, 1);
    }
}
