//! What a CREATE describes: from XML and binary representations to a plan.

use super::{Entities, Plan};
use crate::config::Limits;
use crate::topics::TopicKey;
use crate::xml;
use replenish_xrce::wire::{
    EndpointQos, Entity, ObjectId, ObjectKind, QOS_HISTORY_KEEP_LAST, Representation, Status,
    TopicBinary,
};

impl Entities {
    /// The owner and the plan of an entity, or the status that refuses it.
    pub(super) fn plan(
        &self,
        entity: &Entity<'_>,
        limits: &Limits,
    ) -> Result<(ObjectId, Plan), Status> {
        match *entity {
            Entity::Participant { domain, .. } => {
                Ok((ObjectId::INVALID, Plan::Participant { domain }))
            }
            Entity::Topic { repr, participant } => {
                self.domain(participant).ok_or(Status::UNKNOWN_REFERENCE)?;
                let (name, type_name) = topic_names(&repr)?;
                Ok((
                    participant,
                    Plan::Topic {
                        name: name.into(),
                        type_name: type_name.into(),
                    },
                ))
            }
            Entity::Publisher { participant, .. } | Entity::Subscriber { participant, .. } => {
                self.domain(participant).ok_or(Status::UNKNOWN_REFERENCE)?;
                Ok((participant, Plan::Group))
            }
            Entity::DataWriter { repr, publisher } => {
                let domain = self
                    .domain_of_group(publisher, ObjectKind::Publisher)
                    .ok_or(Status::UNKNOWN_REFERENCE)?;
                let (name, type_name) = match repr {
                    Representation::Binary(binary) => self.known_topic(binary.topic)?,
                    Representation::Xml(xml) => xml_topic(xml)?,
                    Representation::Reference(_) => return Err(Status::UNKNOWN_REFERENCE),
                };
                Ok((
                    publisher,
                    Plan::Writer {
                        key: key(domain, name, type_name),
                    },
                ))
            }
            Entity::DataReader { repr, subscriber } => {
                let domain = self
                    .domain_of_group(subscriber, ObjectKind::Subscriber)
                    .ok_or(Status::UNKNOWN_REFERENCE)?;
                let ((name, type_name), depth) = match repr {
                    Representation::Binary(binary) => {
                        let depth = binary.qos.and_then(|qos| depth(&qos.endpoint, limits));
                        (self.known_topic(binary.topic)?, depth)
                    }
                    Representation::Xml(xml) => (xml_topic(xml)?, xml_depth(xml, limits)),
                    Representation::Reference(_) => return Err(Status::UNKNOWN_REFERENCE),
                };
                let depth = depth.unwrap_or(limits.default_depth).min(limits.max_depth);
                let key = key(domain, name, type_name);
                Ok((subscriber, Plan::Reader { key, depth }))
            }
            Entity::Requester { .. } | Entity::Replier { .. } => Err(Status::INCOMPATIBLE),
        }
    }

    fn known_topic(&self, id: ObjectId) -> Result<(&str, &str), Status> {
        self.topic(id).ok_or(Status::UNKNOWN_REFERENCE)
    }
}

fn key(domain: i16, name: &str, type_name: &str) -> TopicKey {
    TopicKey {
        domain,
        name: name.into(),
        type_name: type_name.into(),
    }
}

fn topic_names<'a>(
    repr: &Representation<'a, TopicBinary<'a>>,
) -> Result<(&'a str, &'a str), Status> {
    match repr {
        Representation::Binary(topic) => named(topic.name, topic.type_name),
        Representation::Xml(xml) => xml_topic(xml),
        Representation::Reference(_) => Err(Status::UNKNOWN_REFERENCE),
    }
}

fn xml_topic(xml: &str) -> Result<(&str, &str), Status> {
    let name = xml::text(xml, &["topic", "name"]).unwrap_or_default();
    named(name, xml::text(xml, &["topic", "dataType"]))
}

fn named<'a>(name: &'a str, type_name: Option<&'a str>) -> Result<(&'a str, &'a str), Status> {
    match type_name {
        Some(type_name) if !name.is_empty() && !type_name.is_empty() => Ok((name, type_name)),
        _ => Err(Status::INVALID_DATA),
    }
}

/// How many samples a reader with this QoS keeps; `None` if it does not say.
fn depth(qos: &EndpointQos<'_>, limits: &Limits) -> Option<usize> {
    if qos.flags & QOS_HISTORY_KEEP_LAST == 0 {
        return Some(limits.max_depth);
    }
    qos.depth.filter(|depth| *depth > 0).map(usize::from)
}

fn xml_depth(xml: &str, limits: &Limits) -> Option<usize> {
    let history = xml::element(xml, "historyQos").or_else(|| xml::element(xml, "history"))?;
    if xml::text(history, &["kind"]) == Some("KEEP_ALL") {
        return Some(limits.max_depth);
    }
    xml::text(history, &["depth"])?
        .parse()
        .ok()
        .filter(|depth| *depth > 0)
}
