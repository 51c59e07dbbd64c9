//! How ROS endpoints become XRCE objects.
//!
//! A node is a participant; a topic of a node a topic object, named as ROS 2 names topics on DDS;
//! every writer has a publisher of its own and every reader a subscriber, as in micro-ROS.

use super::backlog::Backlog;
use super::state::{State, backlog, stream};
use crate::middleware::{EndpointSpec, MAX_READERS, MiddlewareError, ReaderId, WriterId};
use crate::qos::{History, Qos, Reliability};
use alloc::format;
use alloc::string::{String, ToString};
use replenish_xrce::client::{RequestError, RequestState};
use replenish_xrce::stream::PushError;
use replenish_xrce::wire::{
    CreationMode, DataReaderBinary, DataWriterBinary, DeliveryControl, EndpointQos, Entity,
    GroupBinary, ObjectId, ObjectKind, ParticipantBinary, QOS_HISTORY_KEEP_LAST, QOS_RELIABLE,
    ReaderQos, Representation, StreamId, TopicBinary, WriterQos,
};

/// The most objects of one kind: ids have twelve bits.
const MAX_NUMBER: usize = 0xfff;

pub(super) struct Reader {
    pub(super) object: ObjectId,
    pub(super) max_size: usize,
    pub(super) backlog: Backlog,
    pub(super) lost: u64,
}

pub(super) struct Writer {
    pub(super) object: ObjectId,
    pub(super) stream: StreamId,
    pub(super) max_size: usize,
}

pub(super) struct Topic {
    participant: ObjectId,
    name: String,
    type_name: String,
    object: ObjectId,
}

impl State {
    /// Asks for everything a writer needs.
    pub(super) fn add_writer(
        &mut self,
        spec: &EndpointSpec<'_>,
        domain: i16,
    ) -> Result<(WriterId, ObjectId), MiddlewareError> {
        let stream = stream(spec.qos.reliability == Reliability::Reliable);
        self.check(spec, self.session.limit(stream).unwrap_or(0))?;
        let number = number(self.writers.len(), MAX_NUMBER, "writers")?;
        let topic = self.topic(spec, domain)?;
        let publisher = ObjectId::new(number, ObjectKind::Publisher);
        let object = ObjectId::new(number, ObjectKind::DataWriter);
        let participant = self.participant(spec.node, domain)?;
        let group = Representation::Binary(GroupBinary::default());
        self.create(
            publisher,
            &Entity::Publisher {
                repr: group,
                participant,
            },
        )?;
        let qos = WriterQos {
            endpoint: qos(&spec.qos),
            ownership_strength: None,
        };
        let repr = Representation::Binary(DataWriterBinary {
            topic,
            qos: Some(qos),
        });
        self.create(object, &Entity::DataWriter { repr, publisher })?;
        self.writers.push(Writer {
            object,
            stream,
            max_size: spec.max_size,
        });
        Ok((WriterId(number - 1), object))
    }

    /// Asks for everything a reader needs, and for its samples.
    pub(super) fn add_reader(
        &mut self,
        spec: &EndpointSpec<'_>,
        domain: i16,
        max_sample: usize,
        mtu: u16,
    ) -> Result<(ReaderId, ObjectId), MiddlewareError> {
        let reliable = spec.qos.reliability == Reliability::Reliable;
        let one_message = usize::from(mtu).saturating_sub(OVERHEAD);
        self.check(spec, if reliable { max_sample } else { one_message })?;
        let number = number(self.readers.len(), MAX_READERS, "readers")?;
        let topic = self.topic(spec, domain)?;
        let subscriber = ObjectId::new(number, ObjectKind::Subscriber);
        let object = ObjectId::new(number, ObjectKind::DataReader);
        let participant = self.participant(spec.node, domain)?;
        let group = Representation::Binary(GroupBinary::default());
        self.create(
            subscriber,
            &Entity::Subscriber {
                repr: group,
                participant,
            },
        )?;
        let qos = ReaderQos {
            endpoint: qos(&spec.qos),
            ..ReaderQos::default()
        };
        let repr = Representation::Binary(DataReaderBinary {
            topic,
            qos: Some(qos),
        });
        self.create(object, &Entity::DataReader { repr, subscriber })?;
        self.session
            .read(object, stream(reliable), DeliveryControl::UNLIMITED)
            .map_err(|error| request_error(&error))?;
        let keep_last = spec.qos.history == History::KeepLast;
        self.readers.push(Reader {
            object,
            max_size: spec.max_size,
            backlog: backlog(spec.qos.depth, spec.max_size, keep_last),
            lost: 0,
        });
        Ok((ReaderId(number - 1), object))
    }

    /// What the agent said to the creation of `object`; `None` while it has said nothing.
    pub(super) fn outcome(
        &self,
        object: ObjectId,
        what: &'static str,
    ) -> Option<Result<(), MiddlewareError>> {
        match self.session.creation(object) {
            Some(RequestState::Queued | RequestState::Asked) => None,
            Some(RequestState::Done) => Some(Ok(())),
            Some(RequestState::Refused(status)) => Some(Err(MiddlewareError::Refused {
                what,
                status: status.0,
            })),
            None => Some(Err(MiddlewareError::NoAnswer { what })),
        }
    }

    /// Takes a writer back that the agent has not created.
    pub(super) fn abandon_writer(&mut self, object: ObjectId) {
        let publisher = ObjectId::new(object.number(), ObjectKind::Publisher);
        self.abandon([object, publisher]);
        if self
            .writers
            .last()
            .is_some_and(|writer| writer.object == object)
        {
            self.writers.pop();
        }
    }

    /// Takes a reader back that the agent has not created.
    pub(super) fn abandon_reader(&mut self, object: ObjectId) {
        let subscriber = ObjectId::new(object.number(), ObjectKind::Subscriber);
        self.abandon([object, subscriber]);
        if self
            .readers
            .last()
            .is_some_and(|reader| reader.object == object)
        {
            self.readers.pop();
        }
    }

    fn abandon(&mut self, objects: [ObjectId; 2]) {
        for object in objects {
            // If the agent cannot be told, it forgets them with the session.
            self.session.delete(object).ok();
        }
    }

    /// Whether an endpoint with this specification can be created at all.
    fn check(&self, spec: &EndpointSpec<'_>, limit: usize) -> Result<(), MiddlewareError> {
        if !self.is_up() {
            return Err(MiddlewareError::LinkDown);
        }
        if spec.max_size > limit {
            return Err(MiddlewareError::TooLarge {
                size: spec.max_size,
                limit,
            });
        }
        Ok(())
    }

    fn participant(&mut self, node: &str, domain: i16) -> Result<ObjectId, MiddlewareError> {
        if let Some((_, object)) = self.participants.iter().find(|(name, _)| name == node) {
            return Ok(*object);
        }
        let number = number(self.participants.len(), MAX_NUMBER, "nodes")?;
        let object = ObjectId::new(number, ObjectKind::Participant);
        let name = Some(node.trim_start_matches('/'));
        let repr = Representation::Binary(ParticipantBinary {
            domain_reference: None,
            name,
        });
        self.create(object, &Entity::Participant { repr, domain })?;
        self.participants.push((node.to_string(), object));
        Ok(object)
    }

    fn topic(&mut self, spec: &EndpointSpec<'_>, domain: i16) -> Result<ObjectId, MiddlewareError> {
        let participant = self.participant(spec.node, domain)?;
        let same = |topic: &&Topic| {
            topic.participant == participant
                && topic.name == spec.topic
                && topic.type_name == spec.dds_type_name
        };
        if let Some(topic) = self.topics.iter().find(same) {
            return Ok(topic.object);
        }
        let number = number(self.topics.len(), MAX_NUMBER, "topics")?;
        let object = ObjectId::new(number, ObjectKind::Topic);
        let name = format!("rt{}", spec.topic);
        let binary = TopicBinary {
            name: &name,
            type_reference: None,
            type_name: Some(spec.dds_type_name),
        };
        let repr = Representation::Binary(binary);
        self.create(object, &Entity::Topic { repr, participant })?;
        self.topics.push(Topic {
            participant,
            name: spec.topic.to_string(),
            type_name: spec.dds_type_name.to_string(),
            object,
        });
        Ok(object)
    }

    fn create(&mut self, object: ObjectId, entity: &Entity<'_>) -> Result<(), MiddlewareError> {
        self.session
            .create(object, CreationMode::REUSE_OR_REPLACE, entity)
            .map_err(|error| request_error(&error))
    }
}

/// Bytes of a datagram besides the one sample in it.
const OVERHEAD: usize = 12;

/// The number of the next object, from 1 on.
fn number(count: usize, limit: usize, what: &'static str) -> Result<u16, MiddlewareError> {
    u16::try_from(count + 1)
        .ok()
        .filter(|_| count < limit)
        .ok_or(MiddlewareError::Capacity { what, limit })
}

fn qos(qos: &Qos) -> EndpointQos<'static> {
    let reliable = if qos.reliability == Reliability::Reliable {
        QOS_RELIABLE
    } else {
        0
    };
    let keep_last = if qos.history == History::KeepLast {
        QOS_HISTORY_KEEP_LAST
    } else {
        0
    };
    EndpointQos {
        flags: reliable | keep_last,
        depth: Some(qos.depth),
        ..EndpointQos::default()
    }
}

fn request_error(error: &RequestError) -> MiddlewareError {
    match *error {
        RequestError::JournalFull => MiddlewareError::Capacity {
            what: "objects of the session",
            limit: super::REQUESTS,
        },
        RequestError::Stream(PushError::TooLarge { size, limit }) => {
            MiddlewareError::TooLarge { size, limit }
        }
        RequestError::Down => MiddlewareError::LinkDown,
        _ => MiddlewareError::Unsupported("a name with a NUL inside"),
    }
}
