//! One DDS domain: a participant with what all endpoints in it share.

use crate::config::{DdsConfig, GidSize, Interfaces};
use crate::endpoint::Topic as Name;
use crate::forget;
use crate::graph::{self, NodeInfo};
use crate::qos::Qos;
use crate::raw::Raw;
use rustdds::bytes::Bytes;
use rustdds::no_key::{DataWriter, SimpleDataReader};
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, DomainParticipantStatusListener, GUID, Publisher,
    QosPolicies, RTPSEntity, Subscriber, Topic, TopicKind,
};
use std::collections::HashMap;
use std::fmt::Display;

pub(crate) type Writer = DataWriter<Bytes, Raw>;
pub(crate) type Reader = SimpleDataReader<Vec<u8>, Raw>;

/// A participant.
pub(crate) struct Domain {
    participant: DomainParticipant,
    publisher: Publisher,
    subscriber: Subscriber,
    pub(crate) statuses: DomainParticipantStatusListener,
    /// Every topic there ever was, with its type: RustDDS keeps a cache for each.
    topics: HashMap<String, String>,
    limit: usize,
    graph: Option<Writer>,
    gids: GidSize,
    /// The last number of messages that empty RustDDS's cache of announcements.
    forgotten: i64,
    /// The graph has changed since its last message.
    pub(crate) changed: bool,
}

impl Domain {
    pub(crate) fn new(domain: u16, config: &DdsConfig) -> Result<Self, String> {
        let mut builder = DomainParticipantBuilder::new(domain)
            .socket_receive_buffer_size(1 << 20)
            .socket_send_buffer_size(1 << 20);
        if let Interfaces::Only(addresses) = &config.interfaces {
            builder = builder.with_only_networks(addresses.iter().copied());
        }
        let participant = builder.build().map_err(text("make a participant"))?;
        let none = QosPolicies::qos_none();
        let publisher = participant.create_publisher(&none);
        let subscriber = participant.create_subscriber(&none);
        let mut domain = Self {
            publisher: publisher.map_err(text("make a publisher"))?,
            subscriber: subscriber.map_err(text("make a subscriber"))?,
            statuses: participant.status_listener(),
            participant,
            topics: HashMap::new(),
            limit: config.limits.topics,
            graph: None,
            gids: config.gids,
            forgotten: 0,
            changed: false,
        };
        let topic = Name::new(graph::TOPIC, graph::TYPE);
        domain.graph = Some(domain.writer(&topic, &graph::QOS)?);
        Ok(domain)
    }

    /// Its GUID.
    pub(crate) fn guid(&self) -> GUID {
        self.participant.guid()
    }

    pub(crate) fn writer(&mut self, name: &Name, qos: &Qos) -> Result<Writer, String> {
        let qos = qos.writer();
        let topic = self.topic(name, &qos)?;
        let writer = self.publisher.create_datawriter_no_key(&topic, Some(qos));
        writer.map_err(text("make a writer"))
    }

    pub(crate) fn reader(&mut self, name: &Name, qos: &Qos) -> Result<Reader, String> {
        let qos = qos.reader();
        let topic = self.topic(name, &qos)?;
        let reader = self
            .subscriber
            .create_simple_datareader_no_key(&topic, Some(qos));
        reader.map_err(text("make a reader"))
    }

    /// Whether this topic is the one too many.
    pub(crate) fn is_full_for(&self, name: &Name) -> bool {
        self.topics.len() >= self.limit && !self.topics.contains_key(&name.name)
    }

    /// Gives a name that nothing uses another type; returns whether it had one. RustDDS keeps what
    /// it has received under the name, for readers of either type.
    pub(crate) fn retype(&mut self, name: &Name) -> bool {
        match self.topics.get_mut(&name.name) {
            Some(known) if *known != name.type_name => {
                known.clone_from(&name.type_name);
                true
            }
            _ => false,
        }
    }

    fn topic(&mut self, name: &Name, qos: &QosPolicies) -> Result<Topic, String> {
        match self.topics.get(&name.name) {
            Some(known) if *known != name.type_name => {
                return Err(format!("the topic has the type {known} here already"));
            }
            Some(_) => {}
            None if self.topics.len() >= self.limit => {
                let limit = self.limit;
                return Err(format!(
                    "there were {limit} topics already, dds.limits.topics"
                ));
            }
            None => {
                let (name, type_name) = (name.name.clone(), name.type_name.clone());
                self.topics.insert(name, type_name);
            }
        }
        let (name, type_name) = (name.name.clone(), name.type_name.clone());
        let topic = self
            .participant
            .create_topic(name, type_name, qos, TopicKind::NoKey);
        topic.map_err(text("make a topic"))
    }

    /// Has participants that were silent for too long discovered again.
    pub(crate) fn forget_announcements(&mut self) {
        let place = (
            self.participant.domain_id(),
            self.participant.participant_id(),
        );
        // Without it, such a participant is discovered some time later, or never, as before.
        if let Ok(last) = forget::announcements(place, self.guid(), self.forgotten) {
            self.forgotten = last;
        }
    }

    /// Publishes the nodes on `ros_discovery_info`.
    pub(crate) fn tell(&self, nodes: &[NodeInfo]) {
        let message = graph::encode(self.guid().to_bytes(), nodes, self.gids);
        if let Some(writer) = &self.graph {
            // Nothing is in its way: it keeps one sample, and its window is hundreds.
            drop(writer.write(Bytes::from(message), None));
        }
    }
}

fn text<E: Display>(what: &'static str) -> impl Fn(E) -> String {
    move |error| format!("cannot {what}: {error}")
}
