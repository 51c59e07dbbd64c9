//! Carrying out a CREATE.

use super::calls::Calls;
use super::plan::{MAX_NAME, Plan};
use super::qos::Qos;
use super::reader::{Reader, Role};
use super::records::{Address, Entities, EntityRecord};
use super::topics::{End, TopicEndpoint, TopicKey, Topics};
use super::writer::Writer;
use crate::config::{Grant, Limits, Profiles, TopicRule, service};
use crate::flow::{Charge, Guid, Ledger};
use crate::report::RECORDER_TOPIC;
use replenish_xrce::wire::{Create, CreationMode, ObjectId, Status};
use std::sync::Arc;

/// The longest description that is taken, in bytes; far above what names and QoS need.
const MAX_DEFINITION: usize = 2048;

/// Bytes that an entity is counted with besides its names: its record, both halves, and its places
/// in the tables of topics, turns, notices and the bridge.
pub(crate) const ENTITY_OVERHEAD: usize = 2048;

/// Copies of a name that are counted: the entity's own, which tables share, one that outlives it in
/// them, and those of the bridge.
const NAME_COPIES: usize = 4;

/// Bytes that a requester is counted with for each call that may wait.
const CALL_BYTES: usize = 32;

/// The agent's state that the creation of an entity needs.
pub(crate) struct CreationContext<'a> {
    pub(crate) limits: &'a Limits,
    /// The client's rights, if there is an access list.
    pub(crate) grant: Option<&'a Grant>,
    pub(crate) profiles: &'a Profiles,
    pub(crate) rules: &'a [TopicRule],
    pub(crate) topics: &'a mut Topics<Address>,
    /// GUID of a requester.
    pub(crate) guid: Guid,
    /// The account of the client.
    pub(crate) ledger: Ledger,
}

/// The outcome of a CREATE.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Created {
    pub(crate) status: Status,
    /// An entity with the same id was deleted before.
    pub(crate) deleted: bool,
    /// Writers or readers of the same topics that have another QoS.
    pub(crate) mismatches: usize,
    /// The limit that was met, by name and value, if it was one.
    pub(crate) limit: Option<(&'static str, usize)>,
    /// The topic and its type, or the participant's name, as far as the description is readable.
    pub(crate) subject: Option<(Arc<str>, Option<Arc<str>>)>,
}

/// The answer to a CREATE that is not carried out, with the limit that was met.
type Refused = (Status, Option<(&'static str, usize)>);

impl Entities {
    /// Carries out a CREATE of `size` bytes.
    pub(crate) fn create(
        &mut self,
        create: &Create<'_>,
        size: usize,
        context: &mut CreationContext<'_>,
    ) -> Created {
        let long = size > MAX_DEFINITION;
        let plan = if long {
            Err(Status::RESOURCES)
        } else {
            self.plan(&create.entity, context.profiles, context.limits)
        };
        let subject = plan.as_ref().ok().and_then(Plan::subject);
        let plan = match plan {
            Err(status) if long => Err((status, Some(("bytes of a description", MAX_DEFINITION)))),
            Err(status) => Err((status, None)),
            Ok(plan) => match plan.check_names() {
                Err(status) => {
                    let long = status == Status::RESOURCES;
                    Err((status, long.then_some(("bytes of a name", MAX_NAME))))
                }
                Ok(()) => Ok(plan),
            },
        };
        let (status, deleted, mismatches, limit) = match self.try_create(create, plan, context) {
            Ok((status, deleted, mismatches)) => (status, deleted, mismatches, None),
            Err((status, limit)) => (status, false, 0, limit),
        };
        Created {
            status,
            deleted,
            mismatches,
            limit,
            subject,
        }
    }

    /// The answers for an entity that exists are those of DDS-XRCE 1.0, table 7. Gives the answer,
    /// whether an entity was deleted for it, and the mismatches.
    fn try_create(
        &mut self,
        create: &Create<'_>,
        plan: Result<Plan, Refused>,
        context: &mut CreationContext<'_>,
    ) -> Result<(Status, bool, usize), Refused> {
        let id = create.base.object;
        if id.kind() != Ok(create.entity.kind()) {
            return Err((Status::INVALID_DATA, None));
        }
        let existing = self.records.get(&id);
        let CreationMode { reuse, replace } = create.mode;
        if existing.is_some() && !reuse && !replace {
            return Err((Status::ALREADY_EXISTS, None));
        }
        if let Err((status, limit @ Some(_))) = plan {
            return Err((status, limit));
        }
        if let (Some(grant), Ok(plan)) = (context.grant, &plan)
            && !grant.allows(plan)
        {
            return Err((Status::DENIED, None));
        }
        if let Some(record) = existing.filter(|_| reuse) {
            if plan.as_ref() == Ok(&record.plan) {
                return Ok((Status::OK_MATCHED, false, 0));
            }
            if !replace {
                return Err((Status::MISMATCH, None));
            }
        }
        let most = context.limits.entities;
        if existing.is_none() && self.records.len() >= most {
            return Err((Status::RESOURCES, Some(("limits.entities", most))));
        }
        let plan = plan?;
        let calls = match plan {
            Plan::Requester { .. } => context.limits.calls * CALL_BYTES,
            _ => 0,
        };
        let bytes = ENTITY_OVERHEAD + NAME_COPIES * plan.name_bytes() + calls;
        let most = context.limits.client_bytes;
        let charge = context.ledger.charge(bytes);
        let charge = charge.ok_or((Status::RESOURCES, Some(("limits.client_bytes", most))))?;
        let deleted = self.delete(id, context.topics);
        let mismatches = self.realize(id, plan, charge, context);
        Ok((Status::OK, deleted, mismatches))
    }

    fn realize(
        &mut self,
        id: ObjectId,
        plan: Plan,
        charge: Charge,
        context: &mut CreationContext<'_>,
    ) -> usize {
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
            let records = *key.name == *RECORDER_TOPIC;
            Box::new(Writer::new(topic, qos, records))
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
                _charge: charge,
            },
        );
        mismatches
    }
}
