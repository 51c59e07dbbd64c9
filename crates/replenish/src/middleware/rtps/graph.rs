//! [`Graph`]: which node has which endpoints, for `ros2 node list` and `ros2 topic info`.

use crate::Nanos;
use crate::middleware::MiddlewareError;
use crate::platform::label;
use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;
use replenish_rtps::participant::{EndpointSpec, Participant, WriterId};
use replenish_rtps::ros::{GRAPH_QOS, GRAPH_TOPIC, GRAPH_TYPE, GidSize, Node, encode_graph};
use replenish_rtps::wire::EntityId;

/// Bytes of the message: a thousand endpoints, and their nodes' names.
const BYTES: usize = 32 * 1024;

/// The nodes of this participant.
#[derive(Default)]
pub(super) struct Graph {
    /// The writer of `ros_discovery_info`; made with the first endpoint.
    writer: Option<WriterId>,
    nodes: Vec<NodeEntry>,
}

struct NodeEntry {
    name: Box<str>,
    readers: Vec<EntityId>,
    writers: Vec<EntityId>,
}

impl Graph {
    /// A node has one endpoint more.
    pub(super) fn enter(
        &mut self,
        participant: &mut Participant,
        node: &str,
        entity: EntityId,
        now: Nanos,
    ) -> Result<(), MiddlewareError> {
        let nodes = &mut self.nodes;
        let at = nodes.iter().position(|known| &*known.name == node);
        let at = at.unwrap_or_else(|| {
            nodes.push(NodeEntry {
                name: node.into(),
                readers: Vec::new(),
                writers: Vec::new(),
            });
            nodes.len().saturating_sub(1)
        });
        if let Some(node) = nodes.get_mut(at) {
            node.list(entity).push(entity);
        }
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
        nodes.retain(|node| !(node.readers.is_empty() && node.writers.is_empty()));
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
                let spec = EndpointSpec {
                    qos: GRAPH_QOS,
                    sample_bytes: BYTES,
                    ..EndpointSpec::new(GRAPH_TOPIC, GRAPH_TYPE)
                };
                participant
                    .create_writer(&spec, now)
                    .map_err(|_| full(()))?
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

impl NodeEntry {
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
