//! The seam to another middleware: events from the agent's core, samples to it.
//!
//! ```text
//!   CREATE, DELETE, WRITE_DATA ──► AgentCore ── BridgeEvent ──► bridge ──► DDS
//!   DATA to the one reader     ◄── AgentCore ◄─ BridgeSample ── bridge ◄──┘
//! ```
//!
//! Each writer, reader, requester and replier of a client has one counterpart on the other side,
//! with the same topic, type and QoS, so that matching, history and late joining are the other
//! side's. Between clients samples go through the agent as ever: a bridge must not give back what
//! it got from here, and what comes from it goes to clients only. So nothing goes in circles.

use super::{Asker, NameRefusal, Names};
use crate::entities::{Address, EntityRecord, Plan, Qos, TopicKey};
use crate::flow::{Identity, Sample, shrink};
use replenish_xrce::Nanos;
use replenish_xrce::wire::{Entity, ObjectId};
use std::collections::{HashMap, VecDeque};

/// Samples that may wait for the bridge to ask for them.
const MAX_SAMPLES: usize = 1024;

/// Their bytes: the bridge asks after each batch of datagrams.
pub(crate) const MAX_BYTES: usize = 16 << 20;

/// Identifies a node or endpoint at the seam; never used twice.
pub type BridgeId = u64;

/// An event among the clients.
#[derive(Clone, Debug)]
pub enum BridgeEvent {
    /// A participant: a ROS 2 node.
    Node {
        /// Its id at the seam.
        id: BridgeId,
        /// The domain, as the client says.
        domain: i16,
        /// The participant's name; empty if it has none.
        name: String,
    },
    /// Something that sends or receives.
    Endpoint {
        /// Its id at the seam.
        id: BridgeId,
        /// The domain, as the client says.
        domain: i16,
        /// The participant it belongs to, if that is still there.
        node: Option<BridgeId>,
        /// Its kind.
        kind: BridgeKind,
    },
    /// A node or endpoint is gone.
    Close {
        /// Its id at the seam.
        id: BridgeId,
    },
    /// A client has written.
    Sample {
        /// The endpoint it has written with.
        id: BridgeId,
        /// The sample.
        sample: BridgeSample,
    },
}

/// The kind of a client's endpoint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BridgeKind {
    /// A data writer.
    Writer(BridgeTopic, BridgeQos),
    /// A data reader.
    Reader(BridgeTopic, BridgeQos),
    /// A requester, with the topics of its requests and replies.
    Requester(BridgeTopic, BridgeTopic),
    /// A replier, with the topics of its requests and replies.
    Replier(BridgeTopic, BridgeTopic),
}

/// A topic, as the client names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BridgeTopic {
    /// `rt/chatter`.
    pub name: String,
    /// `std_msgs::msg::dds_::String_`.
    pub type_name: String,
}

/// The QoS that a client wants of a writer or reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BridgeQos {
    /// Reliable or best effort.
    pub reliable: bool,
    /// Transient local or above, or volatile.
    pub durable: bool,
    /// The number of samples that are kept; `None` for all.
    pub depth: Option<usize>,
    /// The longest time between samples.
    pub deadline: Option<Nanos>,
    /// The time for which a writer's samples are of use.
    pub lifespan: Option<Nanos>,
}

/// A sample at the seam.
#[derive(Clone, Debug)]
pub struct BridgeSample {
    payload: Bytes,
    /// Of a request or reply: which one, as a GUID and a number. At a requester the bridge gives
    /// back with the reply the identity it got with the request; at a replier the agent does.
    pub request: Option<([u8; 16], i64)>,
}

#[derive(Clone, Debug)]
enum Bytes {
    Inner(Sample),
    Outer(Vec<u8>),
}

impl BridgeSample {
    /// A sample for a client: CDR without the encapsulation header.
    #[must_use]
    pub fn new(payload: Vec<u8>, request: Option<([u8; 16], i64)>) -> Self {
        Self {
            payload: Bytes::Outer(payload),
            request,
        }
    }

    /// CDR without the encapsulation header.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        match &self.payload {
            Bytes::Inner(sample) => sample,
            Bytes::Outer(bytes) => bytes,
        }
    }
}

/// The core's side of the seam.
#[derive(Debug)]
pub(crate) struct Bridge {
    names: Names,
    /// The topics of endpoints that names were admitted for.
    admitted: HashMap<Address, Vec<TopicKey>>,
    last: BridgeId,
    ids: HashMap<Address, BridgeId>,
    addresses: HashMap<BridgeId, Address>,
    /// The participants of publishers and subscribers.
    groups: HashMap<Address, ObjectId>,
    events: VecDeque<BridgeEvent>,
    samples: usize,
    bytes: usize,
}

impl Bridge {
    pub(crate) fn new(names: Names) -> Self {
        Self {
            names,
            admitted: HashMap::new(),
            last: 0,
            ids: HashMap::new(),
            addresses: HashMap::new(),
            groups: HashMap::new(),
            events: VecDeque::new(),
            samples: 0,
            bytes: 0,
        }
    }

    /// Whether the names of a new entity may cross; to be asked before [`created`](Self::created).
    pub(crate) fn admit(
        &mut self,
        by: Asker,
        address: Address,
        record: &EntityRecord,
    ) -> Result<(), NameRefusal> {
        let keys: &[&TopicKey] = match &record.plan {
            Plan::Participant { .. } | Plan::Topic { .. } | Plan::Group { .. } => return Ok(()),
            Plan::Writer { key, .. } | Plan::Reader { key, .. } => &[key],
            Plan::Requester { request, reply } | Plan::Replier { request, reply } => {
                &[request, reply]
            }
        };
        let mut admitted: Vec<TopicKey> = Vec::new();
        for key in keys {
            let name = (key.domain, &*key.name, &*key.type_name);
            if let Err(refusal) = self.names.admit(by, name) {
                self.release(&admitted);
                return Err(refusal);
            }
            admitted.push((*key).clone());
        }
        self.admitted.insert(address, admitted);
        Ok(())
    }

    fn release(&mut self, keys: &[TopicKey]) {
        for key in keys {
            self.names.release(key.domain, &key.name);
        }
    }

    /// An entity has been created.
    pub(crate) fn created(&mut self, address: Address, entity: &Entity<'_>, record: &EntityRecord) {
        let at = |object| Address { object, ..address };
        let of_group = |group| self.groups.get(&at(group)).copied();
        let participant = match *entity {
            Entity::Publisher { participant, .. } | Entity::Subscriber { participant, .. } => {
                self.groups.insert(address, participant);
                return;
            }
            Entity::Participant { .. } | Entity::Topic { .. } => None,
            Entity::DataWriter { publisher, .. } => of_group(publisher),
            Entity::DataReader { subscriber, .. } => of_group(subscriber),
            Entity::Requester { participant, .. } | Entity::Replier { participant, .. } => {
                Some(participant)
            }
        };
        let node = participant.and_then(|participant| self.ids.get(&at(participant)).copied());
        let (domain, kind) = match &record.plan {
            Plan::Topic { .. } | Plan::Group { .. } => return,
            Plan::Participant { domain, name } => {
                let id = self.name(address);
                let (domain, name) = (*domain, name.to_string());
                self.events
                    .push_back(BridgeEvent::Node { id, domain, name });
                return;
            }
            Plan::Writer { key, qos } => (key.domain, BridgeKind::Writer(key.into(), qos.into())),
            Plan::Reader { key, qos } => (key.domain, BridgeKind::Reader(key.into(), qos.into())),
            Plan::Requester { request, reply } => {
                let kind = BridgeKind::Requester(request.into(), reply.into());
                (request.domain, kind)
            }
            Plan::Replier { request, reply } => {
                let kind = BridgeKind::Replier(request.into(), reply.into());
                (request.domain, kind)
            }
        };
        let id = self.name(address);
        self.events.push_back(BridgeEvent::Endpoint {
            id,
            domain,
            node,
            kind,
        });
    }

    fn name(&mut self, address: Address) -> BridgeId {
        self.last += 1;
        self.ids.insert(address, self.last);
        self.addresses.insert(self.last, address);
        self.last
    }

    /// Notes a deleted entity. Events about it that the bridge has not taken are removed.
    pub(crate) fn deleted(&mut self, address: Address) {
        self.groups.remove(&address);
        if let Some(keys) = self.admitted.remove(&address) {
            self.release(&keys);
        }
        let Some(gone) = self.ids.remove(&address) else {
            return;
        };
        self.addresses.remove(&gone);
        let of_gone = |event: &BridgeEvent| match event {
            BridgeEvent::Node { id, .. } | BridgeEvent::Endpoint { id, .. } => *id == gone,
            _ => false,
        };
        if self.events.iter().any(of_gone) {
            let (samples, bytes) = (&mut self.samples, &mut self.bytes);
            self.events.retain(|event| match event {
                BridgeEvent::Sample { id, sample } if *id == gone => {
                    *samples -= 1;
                    *bytes -= sample.payload().len();
                    false
                }
                event => !of_gone(event),
            });
        } else {
            self.events.push_back(BridgeEvent::Close { id: gone });
        }
    }

    /// All entities of a client are gone.
    pub(crate) fn removed(&mut self, client: usize) {
        self.groups.retain(|address, _| address.client != client);
        let of_client = |address: &&Address| address.client == client;
        let gone: Vec<Address> = self.ids.keys().filter(of_client).copied().collect();
        gone.into_iter().for_each(|address| self.deleted(address));
    }

    /// The name of an entity at the seam.
    pub(crate) fn id(&self, address: Address) -> Option<BridgeId> {
        self.ids.get(&address).copied()
    }

    /// The entity with this name.
    pub(crate) fn address(&self, id: BridgeId) -> Option<Address> {
        self.addresses.get(&id).copied()
    }

    /// A client has written; returns whether there was room.
    pub(crate) fn wrote(&mut self, id: BridgeId, sample: &Sample) -> bool {
        let room = MAX_BYTES.saturating_sub(self.bytes);
        if self.samples >= MAX_SAMPLES || sample.len() > room {
            return false;
        }
        self.samples += 1;
        self.bytes += sample.len();
        let info = sample.info();
        let request = info.request.or(info.reply_to).map(pair);
        let payload = Bytes::Inner(sample.clone());
        let sample = BridgeSample { payload, request };
        self.events.push_back(BridgeEvent::Sample { id, sample });
        true
    }

    /// The next event.
    pub(crate) fn poll(&mut self) -> Option<BridgeEvent> {
        let event = shrink::pop_front(&mut self.events)?;
        if let BridgeEvent::Sample { sample, .. } = &event {
            self.samples -= 1;
            self.bytes -= sample.payload().len();
        }
        Some(event)
    }
}

fn pair(identity: Identity) -> ([u8; 16], i64) {
    (identity.guid.0, identity.seq.cast_signed())
}

impl From<&TopicKey> for BridgeTopic {
    fn from(key: &TopicKey) -> Self {
        Self {
            name: key.name.to_string(),
            type_name: key.type_name.to_string(),
        }
    }
}

impl From<&Qos> for BridgeQos {
    fn from(qos: &Qos) -> Self {
        Self {
            reliable: qos.reliable,
            durable: qos.is_durable(),
            depth: (!qos.keep_all).then_some(qos.depth.max(1)),
            deadline: qos.deadline,
            lifespan: qos.lifespan,
        }
    }
}
