//! The table of a client's entities.

use super::plan::Plan;
use super::reader::{Reader, Role};
use super::topics::{End, TopicId, TopicKey, Topics};
use super::writer::Writer;
use crate::flow::{Charge, Identity, shrink};
use replenish_xrce::wire::{ObjectId, ObjectKind, RequestId, Status};
use std::collections::HashMap;

/// The address of an endpoint: its client's slot in the agent and its id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Address {
    pub(crate) client: usize,
    pub(crate) object: ObjectId,
}

/// All entities of the client in slot `client`.
#[derive(Debug)]
pub(crate) struct Entities {
    pub(super) client: usize,
    pub(super) records: HashMap<ObjectId, EntityRecord>,
}

#[derive(Debug)]
pub(crate) struct EntityRecord {
    pub(crate) plan: Plan,
    pub(crate) writer: Option<Box<Writer>>,
    pub(crate) reader: Option<Box<Reader>>,
    /// A requester: servers beyond the bridge.
    pub(crate) served_beyond: bool,
    /// The last notice to its client: whether it is served.
    pub(crate) notified_served: bool,
    /// The memory of its description.
    pub(super) _charge: Charge,
}

impl Entities {
    pub(crate) fn new(client: usize) -> Self {
        Self {
            client,
            records: HashMap::new(),
        }
    }

    /// Deletes an entity; returns whether it existed.
    pub(crate) fn delete(&mut self, id: ObjectId, topics: &mut Topics<Address>) -> bool {
        let Some(record) = shrink::remove(&mut self.records, &id) else {
            return false;
        };
        let address = Address {
            client: self.client,
            object: id,
        };
        if let Some(writer) = record.writer {
            topics.detach(writer.topic, End::Writer, address);
        }
        if let Some(reader) = record.reader {
            topics.detach(reader.topic, End::Reader, address);
        }
        true
    }

    /// Deletes everything.
    pub(crate) fn clear(&mut self, topics: &mut Topics<Address>) {
        let ids: Vec<ObjectId> = self.records.keys().copied().collect();
        for id in ids {
            self.delete(id, topics);
        }
    }

    /// The sending half of an entity, if it has one.
    pub(crate) fn writer(&mut self, id: ObjectId) -> Option<&mut Writer> {
        self.records.get_mut(&id)?.writer.as_deref_mut()
    }

    /// The sending halves of all entities.
    pub(crate) fn writers(&mut self) -> impl Iterator<Item = &mut Writer> {
        let records = self.records.values_mut();
        records.filter_map(|record| record.writer.as_deref_mut())
    }

    /// The receiving half of an entity, if it has one.
    pub(crate) fn reader(&mut self, id: ObjectId) -> Option<&mut Reader> {
        self.records.get_mut(&id)?.reader.as_deref_mut()
    }

    /// Numbers a request of a requester; also tells whether an older one was forgotten for it.
    /// `None` for other entities.
    pub(crate) fn call(&mut self, id: ObjectId, request: RequestId) -> Option<(Identity, bool)> {
        match &mut self.reader(id)?.role {
            Role::Requester(calls) => Some(calls.call(request)),
            Role::Data | Role::Replier => None,
        }
    }

    /// An entity.
    pub(crate) fn record(&self, id: ObjectId) -> Option<&EntityRecord> {
        self.records.get(&id)
    }

    /// An entity, to be changed.
    pub(crate) fn record_mut(&mut self, id: ObjectId) -> Option<&mut EntityRecord> {
        self.records.get_mut(&id)
    }

    /// The topic of the requests that a replier answers.
    pub(crate) fn answers(&self, id: ObjectId) -> Option<TopicId> {
        let record = self.records.get(&id)?;
        let reader = record.reader.as_deref()?;
        matches!(reader.role, Role::Replier).then_some(reader.topic)
    }

    /// All entities.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (ObjectId, &EntityRecord)> {
        self.records.iter().map(|(id, record)| (*id, record))
    }

    /// The domain of a participant, publisher or subscriber.
    pub(super) fn domain(&self, id: ObjectId, kind: ObjectKind) -> Result<i16, Status> {
        let record = self.records.get(&id).filter(|_| id.kind() == Ok(kind));
        match record.map(|record| &record.plan) {
            Some(Plan::Participant { domain, .. } | Plan::Group { domain }) => Ok(*domain),
            _ => Err(Status::UNKNOWN_REFERENCE),
        }
    }

    pub(super) fn topic(&self, id: ObjectId) -> Option<&TopicKey> {
        match &self.records.get(&id)?.plan {
            Plan::Topic { key } => Some(key),
            _ => None,
        }
    }
}
