//! [`Graph`]: which node has which endpoints: ours, for `ros2 node list` and `ros2 topic info`, and
//! those of other participants.

use crate::Nanos;
use crate::middleware::MiddlewareError;
use crate::platform::label;
use alloc::boxed::Box;
use alloc::collections::BTreeMap;
use alloc::vec;
use alloc::vec::Vec;
use replenish_rtps::participant::{
    ConfigError, EndpointSpec, Limits, Participant, ReaderId, WriterId,
};
use replenish_rtps::ros::{
    GRAPH_QOS, GRAPH_TOPIC, GRAPH_TYPE, GidSize, KnownNodes, Node, NodeLimits, encode_graph,
};
use replenish_rtps::wire::{EntityId, Guid, GuidPrefix, Qos};

/// Bytes of the message: a thousand endpoints, and their nodes' names.
const BYTES: usize = 32 * 1024;
/// Messages of other participants that can be under way at a time.
const MESSAGES: usize = 8;
/// Nodes of others for each participant that may be known.
const NODES: usize = 16;
/// Nodes of one participant: a container of components has many.
const NODES_OF_ONE: usize = 256;

/// The nodes of this participant, and of the others.
pub(super) struct Graph {
    /// The reader of `ros_discovery_info`.
    reader: ReaderId,
    others: KnownNodes,
    /// The writer of `ros_discovery_info`; made with the first node.
    writer: Option<WriterId>,
    nodes: Vec<NodeEntry>,
}

struct NodeEntry {
    name: Box<str>,
    /// Nodes of this name that the program has.
    held: usize,
    readers: Vec<EntityId>,
    writers: Vec<EntityId>,
}

/// Outcome of the messages of other participants.
#[derive(Default)]
pub(super) struct Heard {
    /// Nodes and endpoints beyond the bounds, and names that are none of ROS 2.
    pub(super) left_out: usize,
    /// Messages that could not be read.
    pub(super) malformed: u64,
}

impl Graph {
    /// Listens to the other participants. Memory for their nodes is taken here.
    pub(super) fn new(
        participant: &mut Participant,
        limits: &Limits,
        now: Nanos,
    ) -> Result<Self, ConfigError> {
        let spec = EndpointSpec {
            // As rmw reads it: keep all, for each participant writes its own.
            qos: Qos {
                depth: 0,
                ..GRAPH_QOS
            },
            samples: MESSAGES,
            ..topic()
        };
        let nodes = NodeLimits {
            nodes: limits.participants.saturating_mul(NODES),
            of_one: NODES_OF_ONE,
            endpoints: limits.endpoints,
        };
        Ok(Self {
            reader: participant.create_reader(&spec, now)?,
            others: KnownNodes::new(nodes),
            writer: None,
            nodes: Vec::new(),
        })
    }

    /// Reads what has come from other participants.
    pub(super) fn hear(&mut self, participant: &mut Participant) -> Heard {
        let mut heard = Heard::default();
        while let Some(sample) = participant.take(self.reader) {
            if sample.gone.is_some() {
                continue;
            }
            let from = sample.writer.prefix;
            match self.others.learn(from, sample.payload) {
                Ok(left_out) => heard.left_out += left_out,
                Err(_) => heard.malformed += 1,
            }
            // It may have left since it wrote this.
            self.lost(participant, from);
        }
        heard
    }

    /// A participant is gone, if it has not come back since.
    pub(super) fn lost(&mut self, participant: &Participant, gone: GuidPrefix) {
        if participant.participants().all(|known| known.prefix != gone) {
            self.others.forget(gone);
        }
    }

    /// Messages of other participants that were longer than there is room for.
    pub(super) fn too_long(&self, participant: &Participant) -> u64 {
        let reader = participant.reader(self.reader);
        reader.map_or(0, |reader| reader.stats().too_long)
    }

    /// Some participants may be gone unheard of.
    pub(super) fn lost_some(&mut self, participant: &Participant) {
        let known = |prefix| {
            participant
                .participants()
                .any(|known| known.prefix == prefix)
        };
        self.others.keep(known);
    }

    /// The full names of all nodes, ours first.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        let ours = self.nodes.iter().map(|node| &*node.name);
        ours.chain(self.others.names())
    }

    /// The endpoints of all nodes, with the full names of these.
    pub(super) fn owners(&self, own: GuidPrefix) -> BTreeMap<[u8; 16], &str> {
        let ours = self.nodes.iter().flat_map(|node| {
            let ends = node.readers.iter().chain(&node.writers);
            ends.map(|end| (Guid::new(own, *end), &*node.name))
        });
        let all = ours.chain(self.others.endpoints());
        all.map(|(guid, name)| (guid.to_bytes(), name)).collect()
    }

    /// The program has a node, or one more of the same name.
    pub(super) fn enter_node(
        &mut self,
        participant: &mut Participant,
        node: &str,
        now: Nanos,
    ) -> Result<(), MiddlewareError> {
        let entry = self.entry(node);
        let is_new = entry.is_empty();
        entry.held = entry.held.saturating_add(1);
        if !is_new {
            return Ok(());
        }
        let told = self.tell(participant, now);
        if told.is_err() {
            self.entry(node).held = 0;
            self.nodes.retain(|node| !node.is_empty());
        }
        told
    }

    /// The program has one node of this name less.
    pub(super) fn leave_node(&mut self, participant: &mut Participant, node: &str, now: Nanos) {
        let entry = self.entry(node);
        entry.held = entry.held.saturating_sub(1);
        if entry.is_empty() {
            self.nodes.retain(|node| !node.is_empty());
            // A list that is shorter than the last one fits.
            self.tell(participant, now).ok();
        }
    }

    fn entry(&mut self, node: &str) -> &mut NodeEntry {
        let nodes = &mut self.nodes;
        let at = nodes.iter().position(|known| &*known.name == node);
        let at = at.unwrap_or(nodes.len());
        if at == nodes.len() {
            nodes.push(NodeEntry {
                name: node.into(),
                held: 0,
                readers: Vec::new(),
                writers: Vec::new(),
            });
        }
        &mut nodes[at]
    }

    /// A node has one endpoint more.
    pub(super) fn enter(
        &mut self,
        participant: &mut Participant,
        node: &str,
        entity: EntityId,
        now: Nanos,
    ) -> Result<(), MiddlewareError> {
        self.entry(node).list(entity).push(entity);
        self.tell(participant, now)
    }

    /// An endpoint is gone.
    pub(super) fn leave(
        &mut self,
        participant: &mut Participant,
        node: &str,
        entity: EntityId,
        now: Nanos,
    ) {
        let nodes = &mut self.nodes;
        if let Some(node) = nodes.iter_mut().find(|known| &*known.name == node) {
            node.list(entity).retain(|known| *known != entity);
        }
        nodes.retain(|node| !node.is_empty());
        // A list that is shorter than the last one fits.
        self.tell(participant, now).ok();
    }

    /// Whether this is the writer of `ros_discovery_info`.
    pub(super) fn is_written_by(&self, entity: EntityId) -> bool {
        self.writer.is_some_and(|writer| writer.entity() == entity)
    }

    /// Writes the message again, for a participant that had lost this one.
    ///
    /// Fast DDS forgets the names of nodes then, but not which samples it had.
    pub(super) fn repeat(&mut self, participant: &mut Participant, now: Nanos) {
        if self.writer.is_some() {
            self.tell(participant, now).ok();
        }
    }

    fn tell(&mut self, participant: &mut Participant, now: Nanos) -> Result<(), MiddlewareError> {
        let full = |_| MiddlewareError::Capacity {
            what: label("nodes and endpoints in ros_discovery_info, of 32 kB"),
            limit: BYTES,
        };
        let writer = match self.writer {
            Some(writer) => writer,
            None => {
                let made = participant.create_writer(&topic(), now);
                made.map_err(|_| full(()))?
            }
        };
        self.writer = Some(writer);
        let nodes: Vec<_> = self.nodes.iter().map(NodeEntry::as_node).collect();
        let mut buf = vec![0; BYTES];
        let prefix = participant.prefix();
        let message = encode_graph(&mut buf, prefix, &nodes, GidSize::Bytes16);
        let message = message.map_err(|_| full(()))?;
        let written = participant.write(writer, message, None, now);
        written.map(drop).map_err(|_| full(()))
    }
}

fn topic() -> EndpointSpec<'static> {
    EndpointSpec {
        qos: GRAPH_QOS,
        sample_bytes: BYTES,
        per_participant: true,
        ..EndpointSpec::new(GRAPH_TOPIC, GRAPH_TYPE)
    }
}

impl NodeEntry {
    /// Whether nothing is left of it.
    fn is_empty(&self) -> bool {
        self.held == 0 && self.readers.is_empty() && self.writers.is_empty()
    }

    fn list(&mut self, entity: EntityId) -> &mut Vec<EntityId> {
        if entity.is_reader() {
            &mut self.readers
        } else {
            &mut self.writers
        }
    }

    fn as_node(&self) -> Node<'_> {
        let (namespace, name) = self.name.rsplit_once('/').unwrap_or(("", &self.name));
        Node {
            namespace: if namespace.is_empty() { "/" } else { namespace },
            name,
            readers: &self.readers,
            writers: &self.writers,
        }
    }
}
