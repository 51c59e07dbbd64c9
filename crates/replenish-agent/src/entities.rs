//! The entities of one client: a bounded table, created and deleted by request.
//!
//! ```text
//!   participant (domain) ◄── topic (name, type)
//!        ▲                      ▲
//!        ├── publisher  ◄── data writer ── writer ─┐
//!        ├── subscriber ◄── data reader ── reader ─┤
//!        ├── requester ── writer and reader ───────┼── topics of the agent
//!        └── replier ──── reader and writer ───────┘
//! ```
//!
//! Arrows are looked up when an entity is created, and what it needs is copied: as with eProsima's
//! agents, each entity is deleted by itself, and what was created with its help stays.

mod calls;
mod delivery;
mod describe;
mod qos;
mod reader;
mod writer;

pub(crate) use delivery::Delivery;
pub(crate) use describe::Plan;
pub(crate) use qos::Qos;
pub(crate) use reader::{Reader, Readiness, Role};
pub(crate) use writer::Writer;

use crate::identity::{Guid, Identity};
use crate::limits::Limits;
use crate::profiles::Profiles;
use crate::rules::{TopicRule, service};
use crate::topics::{Attached, End, TopicId, TopicKey, Topics};
use calls::Calls;
use replenish_xrce::wire::{Create, CreationMode, ObjectId, ObjectKind, RequestId, Status};
use std::collections::HashMap;

/// The address of an endpoint: its client's slot in the agent and its id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Address {
    pub(crate) client: usize,
    pub(crate) object: ObjectId,
}

/// The longest description that is taken, in bytes; far above what names and QoS need.
pub(crate) const MAX_DEFINITION: usize = 2048;

/// What the creation of entities depends on besides the client.
pub(crate) struct Surroundings<'a> {
    pub(crate) limits: &'a Limits,
    pub(crate) profiles: &'a Profiles,
    pub(crate) rules: &'a [TopicRule],
    pub(crate) topics: &'a mut Topics<Address>,
    /// For a requester.
    pub(crate) guid: Guid,
}

/// What a CREATE did.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Created {
    pub(crate) status: Status,
    /// An entity with the same id was deleted before.
    pub(crate) deleted: bool,
    /// Writers or readers of the same topics that have another QoS.
    pub(crate) mismatches: usize,
}

/// All entities of the client in slot `client`.
#[derive(Debug)]
pub(crate) struct Entities {
    client: usize,
    records: HashMap<ObjectId, Record>,
}

#[derive(Debug)]
pub(crate) struct Record {
    pub(crate) plan: Plan,
    pub(crate) writer: Option<Box<Writer>>,
    pub(crate) reader: Option<Box<Reader>>,
    /// A requester: servers beyond the bridge.
    pub(crate) served_beyond: bool,
    /// What its client was told last: whether it is served.
    pub(crate) told_served: bool,
}

impl Entities {
    pub(crate) fn new(client: usize) -> Self {
        Self {
            client,
            records: HashMap::new(),
        }
    }

    /// Carries out a CREATE of `size` bytes.
    pub(crate) fn create(
        &mut self,
        create: &Create<'_>,
        size: usize,
        around: &mut Surroundings<'_>,
    ) -> Created {
        let done = self.try_create(create, size, around);
        done.unwrap_or_else(|status| Created {
            status,
            deleted: false,
            mismatches: 0,
        })
    }

    /// The answers for an entity that exists are those of DDS-XRCE 1.0, table 7.
    fn try_create(
        &mut self,
        create: &Create<'_>,
        size: usize,
        around: &mut Surroundings<'_>,
    ) -> Result<Created, Status> {
        let id = create.base.object;
        if id.kind() != Ok(create.entity.kind()) {
            return Err(Status::INVALID_DATA);
        }
        let existing = self.records.get(&id);
        let CreationMode { reuse, replace } = create.mode;
        if existing.is_some() && !reuse && !replace {
            return Err(Status::ALREADY_EXISTS);
        }
        if size > MAX_DEFINITION {
            return Err(Status::RESOURCES);
        }
        let plan = self.plan(&create.entity, around.profiles, around.limits);
        if let Some(record) = existing.filter(|_| reuse) {
            if plan.as_ref() == Ok(&record.plan) {
                return Ok(Created {
                    status: Status::OK_MATCHED,
                    deleted: false,
                    mismatches: 0,
                });
            }
            if !replace {
                return Err(Status::MISMATCH);
            }
        } else if existing.is_none() && self.records.len() >= around.limits.entities {
            return Err(Status::RESOURCES);
        }
        let plan = plan?;
        let deleted = self.delete(id, around.topics);
        let mismatches = self.realize(id, plan, around);
        Ok(Created {
            status: Status::OK,
            deleted,
            mismatches,
        })
    }

    fn realize(&mut self, id: ObjectId, plan: Plan, around: &mut Surroundings<'_>) -> usize {
        let limits = around.limits;
        let for_services = Qos::service(limits);
        let (writes, reads) = match &plan {
            Plan::Participant { .. } | Plan::Topic { .. } | Plan::Group { .. } => (None, None),
            Plan::Writer { key, qos } => (Some((key, *qos)), None),
            Plan::Reader { key, qos } => (None, Some((key, *qos, Role::Data))),
            Plan::Requester { request, reply } => {
                let role = Role::Requester(Calls::new(around.guid, id, limits.calls));
                (
                    Some((request, for_services)),
                    Some((reply, for_services, role)),
                )
            }
            Plan::Replier { request, reply } => (
                Some((reply, for_services)),
                Some((request, for_services, Role::Replier)),
            ),
        };
        let client = self.client;
        let mut mismatches = 0;
        let mut attach = |key: &TopicKey, end, qos| {
            let object = id;
            let address = Address { client, object };
            let (topic, n) = around.topics.attach(key, end, Attached { address, qos });
            mismatches += n;
            topic
        };
        let writer = writes.map(|(key, qos)| {
            let topic = attach(key, End::Writer, qos);
            Box::new(Writer::new(topic, qos))
        });
        let reader = reads.map(|(key, qos, role)| {
            let topic = attach(key, End::Reader, qos);
            let service = service(around.rules, &key.name);
            Box::new(Reader::new(topic, qos, service, role))
        });
        self.records.insert(
            id,
            Record {
                plan,
                writer,
                reader,
                served_beyond: false,
                told_served: false,
            },
        );
        mismatches
    }

    /// Deletes an entity; returns whether it existed.
    pub(crate) fn delete(&mut self, id: ObjectId, topics: &mut Topics<Address>) -> bool {
        let Some(record) = self.records.remove(&id) else {
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
    pub(crate) fn record(&self, id: ObjectId) -> Option<&Record> {
        self.records.get(&id)
    }

    /// An entity, to be changed.
    pub(crate) fn record_mut(&mut self, id: ObjectId) -> Option<&mut Record> {
        self.records.get_mut(&id)
    }

    /// The topic of the requests that a replier answers.
    pub(crate) fn answers(&self, id: ObjectId) -> Option<TopicId> {
        let record = self.records.get(&id)?;
        let reader = record.reader.as_deref()?;
        matches!(reader.role, Role::Replier).then_some(reader.topic)
    }

    /// All entities.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (ObjectId, &Record)> {
        self.records.iter().map(|(id, record)| (*id, record))
    }

    /// The domain of a participant, publisher or subscriber.
    fn domain(&self, id: ObjectId, kind: ObjectKind) -> Result<i16, Status> {
        let record = self.records.get(&id).filter(|_| id.kind() == Ok(kind));
        match record.map(|record| &record.plan) {
            Some(Plan::Participant { domain, .. } | Plan::Group { domain }) => Ok(*domain),
            _ => Err(Status::UNKNOWN_REFERENCE),
        }
    }

    fn topic(&self, id: ObjectId) -> Option<&TopicKey> {
        match &self.records.get(&id)?.plan {
            Plan::Topic { key } => Some(key),
            _ => None,
        }
    }
}
