//! The bridge to DDS: events of the core go to [`crate::dds`], samples from there to the
//! core. Runs in the agent's thread and never waits; DDS has a thread of its own.

use crate::agent_core::{AgentCore, Now};
use crate::bridge::{BridgeEvent, BridgeId, BridgeKind, BridgeQos, BridgeSample, BridgeTopic};
use crate::config::DdsBridge;
use crate::dds::{
    Dds, DdsError, Durability, Endpoint, EndpointKind, EndpointState, History, Mismatch, Node,
    OpenError, Outgoing, Qos, RequestId, Topic,
};
use crate::report::BridgeSnapshot;
use replenish_os::WakeFd;
use replenish_xrce::wire::Notice;
use std::collections::BTreeMap;
use std::hash::Hash;
use std::sync::Arc;

/// Samples taken from DDS in one batch.
const BATCH: usize = 64;

/// DDS, and the entities that it did not take.
#[derive(Debug)]
pub(super) struct DdsPort {
    dds: Dds,
    /// The DDS domain of clients that say 0.
    domain: u16,
    about: BTreeMap<BridgeId, About>,
    /// Entities that wait until DDS has room for them.
    waiting: BTreeMap<BridgeId, DdsEntity>,
    /// Entities that DDS refused, and the reasons.
    refused: BTreeMap<BridgeId, (String, OpenError)>,
    wake: Arc<WakeFd>,
}

/// A client's entity, for reports.
#[derive(Clone, Debug, Default)]
struct About {
    kind: &'static str,
    node: Option<BridgeId>,
    domain: u16,
    type_name: String,
}

#[derive(Clone, Debug)]
enum DdsEntity {
    Node(Node),
    Endpoint(Endpoint),
}

/// The policies as [`Notice`]'s bits.
fn policies(mismatch: Mismatch) -> u8 {
    let bit = |clashes: bool, bit: u8| if clashes { bit } else { 0 };
    bit(mismatch.reliability, Notice::RELIABILITY)
        | bit(mismatch.durability, Notice::DURABILITY)
        | bit(mismatch.deadline, Notice::DEADLINE)
}

impl DdsEntity {
    fn name(&self) -> &str {
        match self {
            Self::Node(node) => &node.name,
            Self::Endpoint(endpoint) => &endpoint.kind.topic().name,
        }
    }
}

impl DdsPort {
    pub(super) fn start(config: &DdsBridge, wake: &Arc<WakeFd>) -> Result<Self, DdsError> {
        Ok(Self {
            dds: Dds::start(&config.dds, Arc::clone(wake))?,
            domain: config.domain,
            about: BTreeMap::new(),
            waiting: BTreeMap::new(),
            refused: BTreeMap::new(),
            wake: Arc::clone(wake),
        })
    }

    /// Carries the core's events to DDS.
    pub(super) fn tell<P: Copy + Eq + Hash>(&mut self, core: &mut AgentCore<P>) {
        while let Some(event) = core.poll_bridge() {
            match event {
                BridgeEvent::Node { id, domain, name } => {
                    let domain = self.domain(domain);
                    let name = if name.is_empty() {
                        format!("xrce_{id}") // ROS 2 knows no node without a name
                    } else {
                        name
                    };
                    self.open(id, "participant", DdsEntity::Node(Node { domain, name }));
                }
                BridgeEvent::Endpoint {
                    id,
                    domain,
                    node,
                    kind,
                } => {
                    let domain = self.domain(domain);
                    let (name, kind) = kind.into_dds();
                    let endpoint = Endpoint { domain, node, kind };
                    self.open(id, name, DdsEntity::Endpoint(endpoint));
                }
                BridgeEvent::Close { id } => self.close(id),
                BridgeEvent::Sample { id, sample } => {
                    let payload = sample.payload().to_vec();
                    let request = sample
                        .request
                        .map(|(guid, sequence)| RequestId { guid, sequence });
                    self.dds.write(id, Outgoing { payload, request });
                }
            }
        }
    }

    /// Gives the core a batch of samples from DDS, and wakes the agent again if there may be more.
    pub(super) fn take<P: Copy + Eq + Hash>(&mut self, core: &mut AgentCore<P>, now: Now) {
        while let Some((id, served)) = self.dds.take_served() {
            core.served_beyond(id, served);
        }
        while let Some((id, mismatch)) = self.dds.take_mismatch() {
            core.incompatible_beyond(id, policies(mismatch));
        }
        core.left_out_beyond(self.dds.left_out());
        for _ in 0..BATCH {
            let Some((id, incoming)) = self.dds.take() else {
                return;
            };
            let request = incoming.request.map(|id| (id.guid, id.sequence));
            core.from_bridge(now, id, &BridgeSample::new(incoming.payload, request));
        }
        self.wake.wake();
    }

    /// The state of the clients' entities in DDS.
    pub(super) fn snapshot<P: Copy + Eq + Hash>(&self, core: &AgentCore<P>) -> Vec<BridgeSnapshot> {
        let report = self.dds.report();
        let row = |id: BridgeId| {
            let about = self.about.get(&id).cloned().unwrap_or_default();
            let mut row = BridgeSnapshot {
                kind: about.kind,
                domain: about.domain,
                type_name: about.type_name,
                ..BridgeSnapshot::default()
            };
            core.name_bridge_row(id, about.node, &mut row);
            row
        };
        let open = report.endpoints.into_iter().map(|found| BridgeSnapshot {
            name: found.name,
            state: match (report.ended.clone(), found.state) {
                (Some(why), _) | (None, EndpointState::Failed(why)) => why,
                (None, EndpointState::Opening) => "opening".into(),
                (None, EndpointState::Open) => "open".into(),
            },
            matched: found.matched,
            waiting: found.waiting_out,
            counts: found.counts,
            ..row(found.id)
        });
        let not_open = |id: BridgeId, name: &str, error: OpenError| BridgeSnapshot {
            name: name.into(),
            state: error.to_string(),
            ..row(id)
        };
        let waiting = self.waiting.iter();
        let waiting = waiting.map(|(id, entity)| not_open(*id, entity.name(), OpenError::Full));
        let refused = self.refused.iter();
        let refused = refused.map(|(id, (name, why))| not_open(*id, name, *why));
        open.chain(waiting).chain(refused).collect()
    }

    /// The DDS domain; one that does not exist is refused later.
    fn domain(&self, of_client: i16) -> u16 {
        match of_client {
            0 => self.domain,
            other => u16::try_from(other).unwrap_or(u16::MAX),
        }
    }

    fn open(&mut self, id: BridgeId, kind: &'static str, entity: DdsEntity) {
        let mut about = About {
            kind,
            ..About::default()
        };
        match &entity {
            DdsEntity::Node(node) => {
                about.domain = node.domain;
                about.node = Some(id);
            }
            DdsEntity::Endpoint(endpoint) => {
                (about.domain, about.node) = (endpoint.domain, endpoint.node);
                about.type_name.clone_from(&endpoint.kind.topic().type_name);
            }
        }
        self.about.insert(id, about);
        self.try_open(id, entity);
    }

    fn try_open(&mut self, id: BridgeId, entity: DdsEntity) {
        let opened = match entity.clone() {
            DdsEntity::Node(node) => self.dds.open_node(id, node),
            DdsEntity::Endpoint(endpoint) => self.dds.open(id, endpoint),
        };
        match opened {
            Ok(()) => {}
            Err(OpenError::Full) => {
                self.waiting.insert(id, entity);
            }
            Err(why) => {
                self.refused.insert(id, (entity.name().into(), why));
            }
        }
    }

    fn close(&mut self, id: BridgeId) {
        self.about.remove(&id);
        self.refused.remove(&id);
        if self.waiting.remove(&id).is_some() {
            return;
        }
        self.dds.close(id);
        if let Some((id, entity)) = self.waiting.pop_first() {
            self.try_open(id, entity);
        }
    }
}

impl BridgeKind {
    fn into_dds(self) -> (&'static str, EndpointKind) {
        let topic = |topic: BridgeTopic| Topic {
            name: topic.name,
            type_name: topic.type_name,
        };
        match self {
            Self::Writer(on, qos) => {
                let (topic, qos) = (topic(on), qos.into());
                ("data_writer", EndpointKind::Writer { topic, qos })
            }
            Self::Reader(on, qos) => {
                let (topic, qos) = (topic(on), qos.into());
                ("data_reader", EndpointKind::Reader { topic, qos })
            }
            Self::Requester(request, reply) => {
                let (request, reply) = (topic(request), topic(reply));
                ("requester", EndpointKind::Requester { request, reply })
            }
            Self::Replier(request, reply) => {
                let (request, reply) = (topic(request), topic(reply));
                ("replier", EndpointKind::Replier { request, reply })
            }
        }
    }
}

impl From<BridgeQos> for Qos {
    fn from(qos: BridgeQos) -> Self {
        Self {
            reliable: qos.reliable,
            durability: if qos.durable {
                Durability::TransientLocal
            } else {
                Durability::Volatile
            },
            history: qos.depth.map_or(History::KeepAll, History::KeepLast),
            deadline: qos.deadline,
            lifespan: qos.lifespan,
        }
    }
}
