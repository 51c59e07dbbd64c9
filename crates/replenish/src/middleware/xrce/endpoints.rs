//! How ROS endpoints become XRCE objects.
//!
//! A node is a participant; a topic of a node a topic object, named as ROS 2 names topics on DDS;
//! every writer has a publisher of its own and every reader a subscriber, as in micro-ROS.

use super::backlog::Backlog;
use super::state::{State, backlog, stream};
use crate::middleware::{EndpointSpec, MiddlewareError, ReaderId, WriterId};
use crate::qos::{Durability, History, IngressLimit, Qos, Reliability};
use crate::text::joined;
use alloc::string::{String, ToString};
use core::time::Duration;
use replenish_xrce::client::{RequestError, RequestState};
use replenish_xrce::stream::PushError;
use replenish_xrce::wire::{
    CreationMode, DataReaderBinary, DataWriterBinary, DeliveryControl, EndpointQos, Entity,
    GroupBinary, ObjectId, ObjectKind, ParticipantBinary, QOS_DURABILITY_TRANSIENT_LOCAL,
    QOS_HISTORY_KEEP_LAST, QOS_RELIABLE, ReaderQos, Representation, StreamId, TopicBinary,
    WriterQos,
};

/// The most objects of one kind: ids have twelve bits.
pub(super) const MAX_NUMBER: usize = 0xffe;

#[cfg_attr(not(feature = "live"), expect(dead_code, reason = "for those that go"))]
pub(super) struct Reader {
    pub(super) object: ObjectId,
    /// Its topic object; services have none.
    pub(super) topic: Option<ObjectId>,
    pub(super) max_size: usize,
    pub(super) backlog: Backlog,
    pub(super) lost: u64,
    /// How a keep-all reader holds the agent back.
    pub(super) flow: Option<Flow>,
    /// It was deleted; its slot is free.
    pub(super) deleted: bool,
}

/// What a keep-all reader has asked its agent for: never more than it has room for.
pub(super) struct Flow {
    pub(super) stream: StreamId,
    pub(super) control: DeliveryControl,
    /// Samples it can keep.
    pub(super) depth: usize,
    /// Samples that may still come.
    pub(super) granted: u16,
}

#[cfg_attr(not(feature = "live"), expect(dead_code, reason = "for those that go"))]
pub(super) struct Writer {
    pub(super) object: ObjectId,
    /// Its topic object; services have none.
    pub(super) topic: Option<ObjectId>,
    pub(super) stream: StreamId,
    pub(super) max_size: usize,
    /// Its object was deleted.
    pub(super) closed: bool,
    /// And nobody uses it any more: its slot is free.
    pub(super) free: bool,
    /// A requester: the agent knows a server.
    pub(super) served: bool,
}

impl Writer {
    pub(super) const fn new(
        object: ObjectId,
        topic: Option<ObjectId>,
        stream: StreamId,
        max_size: usize,
    ) -> Self {
        Self {
            object,
            topic,
            stream,
            max_size,
            closed: false,
            free: false,
            served: false,
        }
    }
}

pub(super) struct Topic {
    participant: ObjectId,
    pub(super) name: String,
    type_name: String,
    pub(super) object: ObjectId,
    /// Readers and writers.
    pub(super) users: usize,
}

impl State {
    /// Asks for everything a writer needs.
    pub(super) fn add_writer(
        &mut self,
        spec: &EndpointSpec<'_>,
        domain: i16,
    ) -> Result<(WriterId, ObjectId), MiddlewareError> {
        let reliable = spec.qos.reliability == Reliability::Reliable;
        let stream = stream(reliable, spec.qos.criticality);
        self.check(spec, self.session.limit(stream).unwrap_or(0))?;
        let number = self.writer_number()?;
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
        let writer = Writer::new(object, Some(topic), stream, spec.max_size);
        Ok((self.place_writer(writer), object))
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
        let (slot, number) = self.reader_place()?;
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
        let keep_last = spec.qos.history == History::KeepLast;
        let mut control = control(spec.ingress);
        let depth = spec.qos.depth.max(1);
        // What is lost on the way would never be asked for again, so best effort has no such thing.
        let counts = control.max_samples == DeliveryControl::UNLIMITED_SAMPLES;
        let stream = stream(reliable, spec.qos.criticality);
        let flow = (reliable && !keep_last && counts).then(|| {
            control.max_samples = depth;
            Flow {
                stream,
                control,
                depth: depth.into(),
                granted: depth,
            }
        });
        self.session
            .read(object, stream, control)
            .map_err(|error| request_error(&error))?;
        let reader = Reader {
            object,
            topic: Some(topic),
            max_size: spec.max_size,
            backlog: backlog(depth, spec.max_size, keep_last),
            lost: 0,
            flow,
            deleted: false,
        };
        Ok((self.place_reader(slot, reader), object))
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
            Some(RequestState::Unanswered) | None => Some(Err(MiddlewareError::NoAnswer { what })),
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

    pub(super) fn participant(
        &mut self,
        node: &str,
        domain: i16,
    ) -> Result<ObjectId, MiddlewareError> {
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
        let same = |topic: &Topic| {
            topic.participant == participant
                && topic.name == spec.topic
                && topic.type_name == spec.dds_type_name
        };
        let known = self.topics.iter_mut().find(|topic| same(topic));
        if let Some(topic) = known {
            topic.users += 1;
            return Ok(topic.object);
        }
        let topics = &self.topics;
        let taken = |number| topics.iter().any(|t| t.object.number() == number);
        let (what, limit) = ("topics", MAX_NUMBER);
        let full = MiddlewareError::Capacity { what, limit };
        let number = self.topic_numbers.next(taken).ok_or(full)?;
        let object = ObjectId::new(number, ObjectKind::Topic);
        let name = joined(&["rt", spec.topic]);
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
            users: 1,
        });
        Ok(object)
    }

    pub(super) fn create(
        &mut self,
        object: ObjectId,
        entity: &Entity<'_>,
    ) -> Result<(), MiddlewareError> {
        self.session
            .create(object, CreationMode::REUSE_OR_REPLACE, entity)
            .map_err(|error| request_error(&error))
    }
}

/// Bytes of a datagram besides the one sample in it.
pub(super) const OVERHEAD: usize = 12;

/// The number of the next object, from 1 on.
pub(super) fn number(
    count: usize,
    limit: usize,
    what: &'static str,
) -> Result<u16, MiddlewareError> {
    u16::try_from(count + 1)
        .ok()
        .filter(|_| count < limit)
        .ok_or(MiddlewareError::Capacity { what, limit })
}

fn qos(qos: &Qos) -> EndpointQos<'static> {
    let flag = |set: bool, flag: u16| if set { flag } else { 0 };
    let milliseconds = |time: Option<Duration>| {
        time.map(|time| u32::try_from(time.as_millis().max(1)).unwrap_or(u32::MAX))
    };
    let local = qos.durability == Durability::TransientLocal;
    EndpointQos {
        flags: flag(qos.reliability == Reliability::Reliable, QOS_RELIABLE)
            | flag(qos.history == History::KeepLast, QOS_HISTORY_KEEP_LAST)
            | flag(local, QOS_DURABILITY_TRANSIENT_LOCAL),
        depth: Some(qos.depth),
        deadline_ms: milliseconds(qos.deadline),
        lifespan_ms: milliseconds(qos.lifespan),
        user_data: None,
    }
}

fn control(limit: IngressLimit) -> DeliveryControl {
    let pace = limit.min_interval.map_or(0, |pace| {
        let ms = pace.as_micros().div_ceil(1000);
        u16::try_from(ms).unwrap_or(u16::MAX)
    });
    let seconds = |time: Duration| u16::try_from(time.as_secs()).unwrap_or(u16::MAX);
    DeliveryControl {
        max_samples: limit.samples.unwrap_or(DeliveryControl::UNLIMITED_SAMPLES),
        max_elapsed_s: limit.duration.map_or(0, seconds),
        max_bytes_per_second: limit.bytes_per_second.unwrap_or(0),
        min_pace_ms: pace,
    }
}

pub(super) fn request_error(error: &RequestError) -> MiddlewareError {
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
