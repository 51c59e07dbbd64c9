//! Which readers a written sample is for: topics by domain, name and type.

use std::collections::HashMap;

/// What two endpoints must agree on to talk.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct TopicKey {
    pub(crate) domain: i16,
    pub(crate) name: Box<str>,
    pub(crate) type_name: Box<str>,
}

/// A topic in a [`Topics`] table, valid while it is attached to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TopicId(usize);

/// The topics that have a writer or a reader. Bounded by the number of entities of all clients.
///
/// `R` is the address of a reader.
#[derive(Debug)]
pub(crate) struct Topics<R> {
    ids: HashMap<TopicKey, usize>,
    slots: Vec<Slot<R>>,
    free: Vec<usize>,
}

#[derive(Debug)]
struct Slot<R> {
    /// `None` while the slot is free.
    key: Option<TopicKey>,
    /// Writers and readers attached.
    users: usize,
    readers: Vec<R>,
}

impl<R: Copy + PartialEq> Topics<R> {
    pub(crate) fn new() -> Self {
        Self {
            ids: HashMap::new(),
            slots: Vec::new(),
            free: Vec::new(),
        }
    }

    /// Attaches a writer, or with `reader` a reader; the topic comes into being if need be.
    pub(crate) fn attach(&mut self, key: TopicKey, reader: Option<R>) -> TopicId {
        let id = match self.ids.get(&key) {
            Some(&id) => id,
            None => self.insert(key),
        };
        if let Some(slot) = self.slots.get_mut(id) {
            slot.users += 1;
            slot.readers.extend(reader);
        }
        TopicId(id)
    }

    /// Detaches what [`attach`](Self::attach) attached; the last one ends the topic.
    pub(crate) fn detach(&mut self, TopicId(id): TopicId, reader: Option<R>) {
        let Some(slot) = self.slots.get_mut(id) else {
            return;
        };
        if let Some(reader) = reader {
            slot.readers.retain(|r| *r != reader);
        }
        slot.users = slot.users.saturating_sub(1);
        if slot.users == 0
            && let Some(key) = slot.key.take()
        {
            self.ids.remove(&key);
            self.free.push(id);
        }
    }

    /// The readers of a topic, in the order in which they came.
    pub(crate) fn readers(&self, TopicId(id): TopicId) -> &[R] {
        self.slots.get(id).map_or(&[], |slot| &slot.readers)
    }

    fn insert(&mut self, key: TopicKey) -> usize {
        let slot = Slot {
            key: Some(key.clone()),
            users: 0,
            readers: Vec::new(),
        };
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

    fn key(domain: i16, name: &str, type_name: &str) -> TopicKey {
        TopicKey {
            domain,
            name: name.into(),
            type_name: type_name.into(),
        }
    }

    #[test]
    fn domain_name_and_type_must_agree() {
        let mut topics = Topics::new();
        let writer = topics.attach(key(0, "t", "A"), None);
        topics.attach(key(0, "t", "A"), Some(1));
        topics.attach(key(1, "t", "A"), Some(2));
        topics.attach(key(0, "u", "A"), Some(3));
        topics.attach(key(0, "t", "B"), Some(4));
        topics.attach(key(0, "t", "A"), Some(5));
        assert_eq!(topics.readers(writer), [1, 5]);
    }

    #[test]
    fn a_topic_ends_with_its_last_user_and_its_slot_is_used_again() {
        let mut topics = Topics::new();
        let a = topics.attach(key(0, "a", "T"), None);
        let same = topics.attach(key(0, "a", "T"), Some(7));
        assert_eq!(a, same);
        topics.detach(a, None);
        assert_eq!(topics.readers(a), [7]);
        topics.detach(a, Some(7));
        let b = topics.attach(key(0, "b", "T"), None);
        assert_eq!(a, b, "the free slot");
        assert!(topics.readers(b).is_empty());
    }
}
