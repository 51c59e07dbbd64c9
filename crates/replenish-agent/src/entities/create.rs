//! Carrying out a CREATE.

use super::calls::Calls;
use super::plan::Plan;
use super::qos::Qos;
use super::reader::{Reader, Role};
use super::records::{Address, Entities, EntityRecord};
use super::topics::{End, TopicEndpoint, TopicKey, Topics};
use super::writer::Writer;
use crate::config::{Limits, Profiles, TopicRule, service};
use crate::flow::Guid;
use replenish_xrce::wire::{Create, CreationMode, ObjectId, Status};

/// The longest description that is taken, in bytes; far above what names and QoS need.
pub(crate) const MAX_DEFINITION: usize = 2048;

/// The agent's state that the creation of an entity needs.
pub(crate) struct CreationContext<'a> {
    pub(crate) limits: &'a Limits,
    pub(crate) profiles: &'a Profiles,
    pub(crate) rules: &'a [TopicRule],
    pub(crate) topics: &'a mut Topics<Address>,
    /// For a requester.
    pub(crate) guid: Guid,
}

/// The outcome of a CREATE.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Created {
    pub(crate) status: Status,
    /// An entity with the same id was deleted before.
    pub(crate) deleted: bool,
    /// Writers or readers of the same topics that have another QoS.
    pub(crate) mismatches: usize,
}

impl Entities {
    /// Carries out a CREATE of `size` bytes.
    pub(crate) fn create(
        &mut self,
        create: &Create<'_>,
        size: usize,
        context: &mut CreationContext<'_>,
    ) -> Created {
        let done = self.try_create(create, size, context);
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
        context: &mut CreationContext<'_>,
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
        let plan = self.plan(&create.entity, context.profiles, context.limits);
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
        } else if existing.is_none() && self.records.len() >= context.limits.entities {
            return Err(Status::RESOURCES);
        }
        let plan = plan?;
        let deleted = self.delete(id, context.topics);
        let mismatches = self.realize(id, plan, context);
        Ok(Created {
            status: Status::OK,
            deleted,
            mismatches,
        })
    }

    fn realize(&mut self, id: ObjectId, plan: Plan, context: &mut CreationContext<'_>) -> usize {
        let limits = context.limits;
        let for_services = Qos::service(limits);
        let (writes, reads) = match &plan {
            Plan::Participant { .. } | Plan::Topic { .. } | Plan::Group { .. } => (None, None),
            Plan::Writer { key, qos } => (Some((key, *qos)), None),
            Plan::Reader { key, qos } => (None, Some((key, *qos, Role::Data))),
            Plan::Requester { request, reply } => {
                let role = Role::Requester(Calls::new(context.guid, id, limits.calls));
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
            let (topic, n) = context
                .topics
                .attach(key, end, TopicEndpoint { address, qos });
            mismatches += n;
            topic
        };
        let writer = writes.map(|(key, qos)| {
            let topic = attach(key, End::Writer, qos);
            Box::new(Writer::new(topic, qos))
        });
        let reader = reads.map(|(key, qos, role)| {
            let topic = attach(key, End::Reader, qos);
            let service = service(context.rules, &key.name);
            Box::new(Reader::new(topic, qos, service, role))
        });
        self.records.insert(
            id,
            EntityRecord {
                plan,
                writer,
                reader,
                served_beyond: false,
                notified_served: false,
            },
        );
        mismatches
    }
}
