//! How ROS endpoints become XRCE objects.
//!
//! A node is a participant; a topic of a node a topic object, named as ROS 2 names topics on DDS;
//! every writer has a publisher of its own and every reader a subscriber, as in micro-ROS.

use super::backlog::{Backlog, Flow};
use super::config::Settings;
use super::describe::{Description, milliseconds};
use super::errors::{request_error, setting};
use super::limits::{MAX_NUMBER, OVERHEAD, SHORT, least_depth, number};
use super::objects::{Reader, State, Topic, Writer};
use super::state::stream;
use crate::middleware::{EndpointSpec, MiddlewareError};
use crate::name::concat;
use crate::platform::{FULL, StaticText, TEXTS, label};
use crate::qos::{History, IngressLimit, Qos, Reliability};
use alloc::boxed::Box;
use alloc::string::ToString;
use core::time::Duration;
use replenish_xrce::client::RequestState;
use replenish_xrce::wire::{CreationMode, DeliveryControl, Entity, ObjectId, ObjectKind};

/// Topic objects are known by name: to be shared, to go with their last user, to be told of.
const KNOWN_TOPICS: bool = FULL || TEXTS;

impl State {
    /// Asks for everything a writer needs, or a reader, and then for its samples. Its id and its
    /// object.
    pub(super) fn add(
        &mut self,
        spec: &EndpointSpec<'_>,
        settings: &Settings,
        writes: bool,
    ) -> Result<(u16, ObjectId), MiddlewareError> {
        let reliable = spec.qos.reliability == Reliability::Reliable;
        let stream = stream(reliable, spec.qos.criticality);
        let limit = self.longest(&spec.qos, settings, writes);
        self.check(spec.max_size, limit, setting(reliable))?;
        let (slot, number) = if writes {
            (0, self.writer_number()?)
        } else {
            self.reader_place()?
        };
        let (group, kind) = if writes {
            (ObjectKind::Publisher, ObjectKind::DataWriter)
        } else {
            (ObjectKind::Subscriber, ObjectKind::DataReader)
        };
        let (group, object) = (ObjectId::new(number, group), ObjectId::new(number, kind));
        let participant = self.participant(spec.node, settings.domain)?;
        let topic = self.topic(spec, participant)?;
        for (object, owner) in [(group, participant), (object, group)] {
            self.describe(object, owner.to_bytes(), spec, topic)?;
        }
        let (topic, max_size) = (Some(topic), spec.max_size);
        if writes {
            let writer = Writer::new(object, topic, stream, max_size);
            return Ok((self.place_writer(writer).0, object));
        }
        let keep_last = spec.qos.history == History::KeepLast;
        let mut control = control(spec.ingress);
        let mut depth = spec.qos.depth.max(1);
        // A lost sample would never be asked for again, so best effort holds nothing back.
        let counts = control.max_samples == DeliveryControl::UNLIMITED_SAMPLES;
        let holds_back = reliable && !keep_last && counts;
        if holds_back {
            depth = depth.max(least_depth(max_size));
            control.max_samples = depth;
        }
        self.session
            .read(object, stream, control)
            .map_err(|error| request_error(&error))?;
        let flow = holds_back.then(|| Box::new(Flow::new(stream, control, depth)));
        let reader = Reader {
            object,
            topic,
            max_size,
            backlog: Backlog::new(depth, max_size, keep_last && !spec.keep_oldest),
            lost: 0,
            flow,
            deleted: false,
        };
        Ok((self.place_reader(slot, reader).0, object))
    }

    /// The longest sample of a writer or reader.
    pub(super) fn longest(&self, qos: &Qos, settings: &Settings, writes: bool) -> usize {
        let reliable = qos.reliability == Reliability::Reliable;
        match (writes, reliable) {
            (true, _) => {
                let stream = stream(reliable, qos.criticality);
                let limit = self.session.limit(stream).unwrap_or(0);
                // The window may hold more than what an agent takes without being asked.
                if FULL {
                    limit.min(settings.max_sample.max(SHORT))
                } else {
                    limit
                }
            }
            (false, true) => settings.max_sample,
            (false, false) => usize::from(settings.mtu).saturating_sub(OVERHEAD),
        }
    }

    /// Whether the agent has said something to the creation of `object`, or never will.
    pub(super) fn is_answered(&self, object: ObjectId) -> bool {
        let state = self.session.creation(object);
        !matches!(state, Some(RequestState::Queued | RequestState::Asked))
    }

    /// The agent's answer to the creation of `object`.
    pub(super) fn outcome(
        &self,
        object: ObjectId,
        what: StaticText,
    ) -> Result<(), MiddlewareError> {
        match self.session.creation(object) {
            Some(RequestState::Done) => Ok(()),
            Some(RequestState::Refused(status)) => {
                let status = status.0;
                Err(MiddlewareError::Refused { what, status })
            }
            _ => Err(MiddlewareError::NoAnswer { what }),
        }
    }

    /// Whether an endpoint with samples of this size can be created at all.
    const fn check(
        &self,
        size: usize,
        limit: usize,
        setting: StaticText,
    ) -> Result<(), MiddlewareError> {
        if !self.is_up() {
            return Err(MiddlewareError::LinkDown);
        }
        if size > limit {
            return Err(MiddlewareError::TooLarge {
                size,
                limit,
                setting,
            });
        }
        Ok(())
    }

    pub(super) fn participant(
        &mut self,
        node: &str,
        domain: i16,
    ) -> Result<ObjectId, MiddlewareError> {
        let known = self.participants.iter().position(|name| *name == node);
        let at = known.unwrap_or(self.participants.len());
        let number = number(at, MAX_NUMBER, label("nodes"))?;
        let object = ObjectId::new(number, ObjectKind::Participant);
        if known.is_none() {
            self.ask_for(&Description {
                object,
                owner: domain.to_le_bytes(),
                name: node,
                type_name: "",
                topic: object,
                qos: const { &Qos::reliable() },
            })?;
            self.participants.push(concat(&[node]));
        }
        Ok(object)
    }

    /// A topic object: the one that the node has for it, where endpoints can go and where they are
    /// told of by name; else one for each endpoint, as in micro-ROS.
    fn topic(
        &mut self,
        spec: &EndpointSpec<'_>,
        participant: ObjectId,
    ) -> Result<ObjectId, MiddlewareError> {
        let same = |topic: &&mut Topic| {
            topic.participant == participant
                && topic.name == spec.topic
                && topic.type_name == spec.dds_type_name
        };
        if KNOWN_TOPICS && let Some(topic) = self.topics.iter_mut().find(same) {
            topic.users += 1;
            return Ok(topic.object);
        }
        let topics = &self.topics;
        let taken = |number| topics.iter().any(|t| t.object.number() == number);
        let (what, limit) = (label("topics"), MAX_NUMBER);
        let full = MiddlewareError::Capacity { what, limit };
        let number = self.topic_numbers.next(taken).ok_or(full)?;
        let object = ObjectId::new(number, ObjectKind::Topic);
        self.describe(object, participant.to_bytes(), spec, object)?;
        if KNOWN_TOPICS {
            self.topics.push(Topic {
                participant,
                name: spec.topic.to_string(),
                type_name: spec.dds_type_name.to_string(),
                object,
                users: 1,
            });
        }
        Ok(object)
    }

    /// Asks for an object that an endpoint needs.
    fn describe(
        &mut self,
        object: ObjectId,
        owner: [u8; 2],
        spec: &EndpointSpec<'_>,
        topic: ObjectId,
    ) -> Result<(), MiddlewareError> {
        self.ask_for(&Description {
            object,
            owner,
            name: spec.topic,
            type_name: spec.dds_type_name,
            topic,
            qos: &spec.qos,
        })
    }

    fn ask_for(&mut self, description: &Description<'_>) -> Result<(), MiddlewareError> {
        self.session
            .create_as(description.object, description)
            .map_err(|error| request_error(&error))
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

fn control(limit: IngressLimit) -> DeliveryControl {
    let pace = limit.min_interval.map_or(0, |pace| {
        u16::try_from(milliseconds(pace, true)).unwrap_or(u16::MAX)
    });
    let seconds = |time: Duration| u16::try_from(time.as_secs()).unwrap_or(u16::MAX);
    DeliveryControl {
        max_samples: limit.samples.unwrap_or(DeliveryControl::UNLIMITED_SAMPLES),
        max_elapsed_s: limit.duration.map_or(0, seconds),
        max_bytes_per_second: limit.bytes_per_second.unwrap_or(0),
        min_pace_ms: pace,
    }
}
