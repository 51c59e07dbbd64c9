//! The entities of one client: a bounded table, created and deleted by request.
//!
//! ```text
//!   participant (domain) ◄── topic (name, type)
//!        ▲                      ▲ copied when the endpoint is created
//!        ├── publisher  ◄── data writer
//!        └── subscriber ◄── data reader (queue, read request)
//! ```
//!
//! Arrows are owners; deleting an owner deletes what it owns.

mod describe;
mod endpoint;

pub(crate) use endpoint::{Reader, Request, Writer};

use crate::config::Limits;
use crate::topics::{TopicKey, Topics};
use replenish_xrce::wire::{Create, CreationMode, ObjectId, ObjectKind, Status};
use std::collections::HashMap;

/// The address of a reader: its client's slot in the agent and its id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ReaderAddress {
    pub(crate) client: usize,
    pub(crate) reader: ObjectId,
}

/// The longest description that is kept, in bytes; far above what names and QoS need.
const MAX_DEFINITION: usize = 2048;

/// All entities of the client in slot `client`.
#[derive(Debug)]
pub(crate) struct Entities {
    client: usize,
    records: HashMap<ObjectId, Record>,
}

#[derive(Debug)]
struct Record {
    owner: ObjectId,
    /// The bytes that described it, to tell whether a second CREATE means the same.
    definition: Box<[u8]>,
    object: Object,
}

#[derive(Debug)]
enum Object {
    Participant { domain: i16 },
    Topic { name: Box<str>, type_name: Box<str> },
    Group,
    Writer(Writer),
    Reader(Box<Reader>),
}

/// What a CREATE asks for, as far as it does not depend on other entities being kept.
enum Plan {
    Participant { domain: i16 },
    Topic { name: Box<str>, type_name: Box<str> },
    Group,
    Writer { key: TopicKey },
    Reader { key: TopicKey, depth: usize },
}

impl Entities {
    pub(crate) fn new(client: usize) -> Self {
        Self {
            client,
            records: HashMap::new(),
        }
    }

    /// Carries out a CREATE. `definition` is the encoded description, owner included.
    /// Returns the status to answer with, and the entities that were deleted for it.
    pub(crate) fn create(
        &mut self,
        create: &Create<'_>,
        definition: &[u8],
        topics: &mut Topics<ReaderAddress>,
        limits: &Limits,
    ) -> (Status, Vec<ObjectId>) {
        match self.try_create(create, definition, topics, limits) {
            Ok(done) => done,
            Err(status) => (status, Vec::new()),
        }
    }

    fn try_create(
        &mut self,
        create: &Create<'_>,
        definition: &[u8],
        topics: &mut Topics<ReaderAddress>,
        limits: &Limits,
    ) -> Result<(Status, Vec<ObjectId>), Status> {
        let id = create.base.object;
        if id.kind() != Ok(create.entity.kind()) {
            return Err(Status::INVALID_DATA);
        }
        if definition.len() > MAX_DEFINITION {
            return Err(Status::RESOURCES);
        }
        let existing = self.records.get(&id);
        if let Some(record) = existing {
            match create.mode {
                CreationMode { reuse: true, .. } if *record.definition == *definition => {
                    return Ok((Status::OK_MATCHED, Vec::new()));
                }
                CreationMode { replace: true, .. } => {}
                CreationMode { reuse: true, .. } => return Err(Status::MISMATCH),
                CreationMode { .. } => return Err(Status::ALREADY_EXISTS),
            }
        } else if self.records.len() >= limits.entities {
            return Err(Status::RESOURCES);
        }
        let (owner, plan) = self.plan(&create.entity, limits)?;
        let deleted = self.delete(id, topics);
        let object = self.realize(id, plan, topics);
        let definition = definition.into();
        self.records.insert(
            id,
            Record {
                owner,
                definition,
                object,
            },
        );
        Ok((Status::OK, deleted))
    }

    fn realize(&self, id: ObjectId, plan: Plan, topics: &mut Topics<ReaderAddress>) -> Object {
        match plan {
            Plan::Participant { domain } => Object::Participant { domain },
            Plan::Topic { name, type_name } => Object::Topic { name, type_name },
            Plan::Group => Object::Group,
            Plan::Writer { key } => Object::Writer(Writer {
                topic: topics.attach(key, None),
            }),
            Plan::Reader { key, depth } => {
                let topic = topics.attach(key, Some(self.address(id)));
                Object::Reader(Box::new(Reader::new(topic, depth)))
            }
        }
    }

    /// Deletes an entity and what it owns; returns their ids, none if it does not exist.
    pub(crate) fn delete(
        &mut self,
        id: ObjectId,
        topics: &mut Topics<ReaderAddress>,
    ) -> Vec<ObjectId> {
        let mut deleted = Vec::new();
        let mut doomed = vec![id];
        while let Some(id) = doomed.pop() {
            let Some(record) = self.records.remove(&id) else {
                continue;
            };
            match record.object {
                Object::Writer(writer) => topics.detach(writer.topic, None),
                Object::Reader(reader) => topics.detach(reader.topic, Some(self.address(id))),
                _ => {}
            }
            deleted.push(id);
            let owned = self.records.iter().filter(|(_, record)| record.owner == id);
            doomed.extend(owned.map(|(id, _)| *id));
        }
        deleted
    }

    /// Deletes everything.
    pub(crate) fn clear(&mut self, topics: &mut Topics<ReaderAddress>) {
        let ids: Vec<ObjectId> = self.records.keys().copied().collect();
        for id in ids {
            self.delete(id, topics);
        }
    }

    pub(crate) fn writer(&self, id: ObjectId) -> Option<&Writer> {
        match &self.records.get(&id)?.object {
            Object::Writer(writer) => Some(writer),
            _ => None,
        }
    }

    pub(crate) fn reader(&mut self, id: ObjectId) -> Option<&mut Reader> {
        match &mut self.records.get_mut(&id)?.object {
            Object::Reader(reader) => Some(reader),
            _ => None,
        }
    }

    /// The domain of a participant.
    fn domain(&self, participant: ObjectId) -> Option<i16> {
        match self.records.get(&participant)?.object {
            Object::Participant { domain } => Some(domain),
            _ => None,
        }
    }

    /// The domain of what belongs to a publisher or subscriber.
    fn domain_of_group(&self, group: ObjectId, kind: ObjectKind) -> Option<i16> {
        let record = self.records.get(&group)?;
        match record.object {
            Object::Group if group.kind() == Ok(kind) => self.domain(record.owner),
            _ => None,
        }
    }

    fn topic(&self, id: ObjectId) -> Option<(&str, &str)> {
        match &self.records.get(&id)?.object {
            Object::Topic { name, type_name } => Some((name, type_name)),
            _ => None,
        }
    }

    fn address(&self, reader: ObjectId) -> ReaderAddress {
        ReaderAddress {
            client: self.client,
            reader,
        }
    }
}
