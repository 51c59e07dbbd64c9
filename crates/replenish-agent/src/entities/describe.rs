//! Makes a plan from the XML, binary form or reference of a CREATE.

use super::plan::Plan;
use super::qos::Qos;
use super::records::Entities;
use super::topics::TopicKey;
use crate::config::{Limits, Profile, Profiles};
use crate::xml;
use replenish_xrce::wire::{
    Entity, ObjectId, ObjectKind, ParticipantBinary, Representation, ServiceBinary, Status,
    TopicBinary,
};

/// In the place of a participant's domain: the one that the profile says.
const DOMAIN_OF_PROFILE: i16 = 255;

impl Entities {
    /// The plan of an entity, or the status that refuses it.
    pub(super) fn plan(
        &self,
        entity: &Entity<'_>,
        profiles: &Profiles,
        limits: &Limits,
    ) -> Result<Plan, Status> {
        let find = |name| {
            let profile = profiles.find(entity.kind(), name);
            profile.ok_or(Status::UNKNOWN_REFERENCE)
        };
        match *entity {
            Entity::Participant { repr, domain } => participant(repr, domain, &find),
            Entity::Topic { repr, participant } => {
                let domain = self.domain(participant, ObjectKind::Participant)?;
                let key = match repr {
                    Representation::Binary(topic) => binary_topic(domain, &topic),
                    Representation::Xml(xml) => xml_topic(domain, xml),
                    Representation::Reference(name) => match find(name)? {
                        Profile::Xml(xml) => xml_topic(domain, xml),
                        Profile::Name(name) => key(domain, name, name),
                    },
                };
                key.map(|key| Plan::Topic { key })
            }
            Entity::Publisher { participant, .. } | Entity::Subscriber { participant, .. } => {
                let domain = self.domain(participant, ObjectKind::Participant)?;
                Ok(Plan::Group { domain })
            }
            Entity::DataWriter { repr, publisher } => {
                let domain = self.domain(publisher, ObjectKind::Publisher)?;
                let by_xml = |xml| Ok((xml_topic(domain, xml)?, xml));
                let default = Qos::writer();
                let (key, qos) = match repr {
                    Representation::Binary(binary) => {
                        let given = binary.qos.map(|qos| qos.endpoint);
                        let qos = given.map(|qos| default.with_binary(&qos, limits));
                        (self.known_topic(domain, binary.topic)?, qos)
                    }
                    Representation::Xml(xml) => {
                        let (key, xml) = by_xml(xml)?;
                        (key, Some(default.with_xml(xml, limits)))
                    }
                    Representation::Reference(name) => match find(name)? {
                        Profile::Xml(xml) => {
                            let (key, xml) = by_xml(xml)?;
                            (key, Some(default.with_xml(xml, limits)))
                        }
                        Profile::Name(name) => (key(domain, name, name)?, None),
                    },
                };
                let qos = qos.unwrap_or(default);
                Ok(Plan::Writer { key, qos })
            }
            Entity::DataReader { repr, subscriber } => {
                let domain = self.domain(subscriber, ObjectKind::Subscriber)?;
                let default = Qos::reader(limits);
                let by_xml = |xml| {
                    let qos = default.with_xml(xml, limits);
                    xml_topic(domain, xml).map(|key| (key, qos))
                };
                let (key, qos) = match repr {
                    Representation::Binary(binary) => {
                        let key = self.known_topic(domain, binary.topic)?;
                        let qos = binary.qos.map_or(default, |qos| {
                            let separation = qos.time_filter_ms.filter(|ms| *ms > 0);
                            Qos {
                                separation: separation.map(|ms| u64::from(ms) * 1_000_000),
                                ..default.with_binary(&qos.endpoint, limits)
                            }
                        });
                        if binary.qos.is_some_and(|qos| qos.content_filter.is_some()) {
                            return Err(Status::INCOMPATIBLE);
                        }
                        (key, qos)
                    }
                    Representation::Xml(xml) => by_xml(xml)?,
                    Representation::Reference(name) => match find(name)? {
                        Profile::Xml(xml) => by_xml(xml)?,
                        Profile::Name(name) => (key(domain, name, name)?, default),
                    },
                };
                Ok(Plan::Reader { key, qos })
            }
            Entity::Requester { repr, participant } => {
                let domain = self.domain(participant, ObjectKind::Participant)?;
                let (request, reply) = service(repr, domain, "requester", &find)?;
                Ok(Plan::Requester { request, reply })
            }
            Entity::Replier { repr, participant } => {
                let domain = self.domain(participant, ObjectKind::Participant)?;
                let (request, reply) = service(repr, domain, "replier", &find)?;
                Ok(Plan::Replier { request, reply })
            }
        }
    }

    /// The topic's name and type in the endpoint's own domain.
    fn known_topic(&self, domain: i16, id: ObjectId) -> Result<TopicKey, Status> {
        let topic = self.topic(id).ok_or(Status::UNKNOWN_REFERENCE)?;
        Ok(TopicKey {
            domain,
            ..topic.clone()
        })
    }
}

fn participant<'a>(
    repr: Representation<'a, ParticipantBinary<'a>>,
    domain: i16,
    find: &impl Fn(&'a str) -> Result<Profile<'a>, Status>,
) -> Result<Plan, Status> {
    let (name, of_profile) = match repr {
        Representation::Binary(binary) => (binary.name.unwrap_or_default(), None),
        Representation::Xml(xml) => (xml::text(xml, &["rtps", "name"]).unwrap_or_default(), None),
        Representation::Reference(name) => match find(name)? {
            Profile::Name(name) => (name, Some(0)),
            Profile::Xml(xml) => {
                let domain = xml::text(xml, &["domainId"]).and_then(|id| id.parse().ok());
                (name, Some(domain.unwrap_or(0)))
            }
        },
    };
    let domain = match of_profile {
        Some(of_profile) if domain == DOMAIN_OF_PROFILE => of_profile,
        _ => domain,
    };
    let name = name.into();
    Ok(Plan::Participant { domain, name })
}

/// The topics of requests and replies. Where a client does not name them they are called after the
/// service, as in Fast DDS.
fn service<'a>(
    repr: Representation<'a, ServiceBinary<'a>>,
    domain: i16,
    tag: &str,
    find: &impl Fn(&'a str) -> Result<Profile<'a>, Status>,
) -> Result<(TopicKey, TopicKey), Status> {
    let by_xml = |xml| {
        let attribute = |name| xml::attribute(xml, tag, name).unwrap_or_default();
        let optional = |name| xml::text(xml, &[name]);
        ServiceBinary {
            service: attribute("service_name"),
            request_type: attribute("request_type"),
            reply_type: attribute("reply_type"),
            request_topic: optional("request_topic_name"),
            reply_topic: optional("reply_topic_name"),
        }
    };
    let service = match repr {
        Representation::Binary(binary) => binary,
        Representation::Xml(xml) => by_xml(xml),
        Representation::Reference(name) => match find(name)? {
            Profile::Xml(xml) => by_xml(xml),
            Profile::Name(name) => ServiceBinary {
                service: name,
                request_type: name,
                reply_type: name,
                request_topic: None,
                reply_topic: None,
            },
        },
    };
    let named = |topic: Option<&str>, suffix| match topic.filter(|topic| !topic.is_empty()) {
        Some(topic) => topic.into(),
        None if service.service.is_empty() => String::new(),
        None => format!("{}{suffix}", service.service),
    };
    let request = named(service.request_topic, "_Request");
    let reply = named(service.reply_topic, "_Reply");
    Ok((
        key(domain, &request, service.request_type)?,
        key(domain, &reply, service.reply_type)?,
    ))
}

fn binary_topic(domain: i16, topic: &TopicBinary<'_>) -> Result<TopicKey, Status> {
    let type_name = topic.type_name.or(topic.type_reference);
    key(domain, topic.name, type_name.unwrap_or_default())
}

/// The topic that XML describes, either itself or in the element of an endpoint.
fn xml_topic(domain: i16, xml: &str) -> Result<TopicKey, Status> {
    let part = |tag| xml::text(xml, &["topic", tag]).unwrap_or_default();
    key(domain, part("name"), part("dataType"))
}

fn key(domain: i16, name: &str, type_name: &str) -> Result<TopicKey, Status> {
    if name.is_empty() || type_name.is_empty() {
        return Err(Status::INVALID_DATA);
    }
    Ok(TopicKey {
        domain,
        name: name.into(),
        type_name: type_name.into(),
    })
}
