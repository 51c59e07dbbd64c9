//! have moved. Rates are differences of two snapshots over [`Snapshot::seconds_since`].
//! have moved. Rates are differences of two snapshots over [`Snapshot::seconds_since`].

use super::refusals::Refusal;
use super::stats::Stats;
use crate::dds::EndpointCounts;
use replenish_xrce::Nanos;

/// The state of an agent at one time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Snapshot {
    /// When, in nanoseconds on the agent's monotonic clock.
    pub at: Nanos,
    /// The counters so far.
    pub stats: Stats,
    /// Topics that have a writer or a reader.
    pub topics: usize,
    /// Bytes of all samples that are kept.
    pub queued_bytes: usize,
    /// The clients, by key.
    pub clients: Vec<ClientSnapshot>,
    /// The last log-ins, and the last requests, that were refused, each the oldest first.
    pub refusals: Vec<Refusal>,
    /// The state in DDS of the clients' participants, writers, readers, requesters and
    /// repliers; `None` without a bridge.
    pub bridge: Option<Vec<BridgeSnapshot>>,
}

/// A participant or endpoint of a client in DDS.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct BridgeSnapshot {
    /// The client's key, as in [`ClientSnapshot::key`].
    pub client: String,
    /// The entity's id, as in [`EntitySnapshot::id`].
    pub id: String,
    /// The ROS 2 node it belongs to: `/talker`; empty without one.
    pub node: String,
    /// The entity's kind, as in [`EntitySnapshot::kind`].
    pub kind: &'static str,
    /// The DDS domain.
    pub domain: u16,
    /// The participant's name, the topic, or the topic of a service's requests.
    pub name: String,
    /// The type of the topic, if it has one.
    pub type_name: String,
    /// `opening`, `open`, or why it is not in DDS.
    pub state: String,
    /// Writers and readers in DDS that it talks with.
    pub matched: usize,
    /// Samples that wait for DDS.
    pub waiting: usize,
    /// Its counters.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub counts: EndpointCounts,
}

/// State of one client.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ClientSnapshot {
    /// Its key, as eight hexadecimal digits.
    pub key: String,
    /// Its session id.
    pub session: u8,
    /// Its address.
    pub peer: String,
    /// Bytes of the longest message it is sent.
    pub mtu: usize,
    /// Nanoseconds since it logged in.
    pub age: Nanos,
    /// Nanoseconds since it was last heard.
    pub silent: Nanos,
    /// Bytes of the agent's memory that it takes.
    pub bytes: usize,
    /// Datagrams from it, dropped ones included.
    pub datagrams_in: u64,
    /// Datagrams to it, outside of a session's replies.
    pub datagrams_out: u64,
    /// Bytes of the datagrams from it.
    pub bytes_in: u64,
    /// Bytes of the datagrams to it.
    pub bytes_out: u64,
    /// Datagrams from it that were dropped because there were too many.
    pub rate_limited: u64,
    /// Whether its address has shown that it receives; before that little is sent there.
    pub echoed: bool,
    /// The streams to it.
    pub streams: Vec<StreamSnapshot>,
    /// Its entities, by id.
    pub entities: Vec<EntitySnapshot>,
}

/// State of one stream to a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct StreamSnapshot {
    /// Its id.
    pub stream: u8,
    /// Messages that are not acknowledged.
    pub unacknowledged: usize,
    /// Messages that were sent again.
    pub resent: u64,
}

/// State of one entity.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct EntitySnapshot {
    /// Its id on the wire, as four hexadecimal digits; the last is the kind.
    pub id: String,
    /// `participant`, `topic`, `publisher`, `subscriber`, `data_writer`, `data_reader`, `requester`
    /// or `replier`.
    pub kind: &'static str,
    /// The DDS domain.
    pub domain: i16,
    /// The participant's name, the topic, or the topic of a service's requests.
    pub name: String,
    /// The type of the topic, if it has one.
    pub type_name: String,
    /// Its sending half.
    pub writer: Option<WriterSnapshot>,
    /// Its receiving half.
    pub reader: Option<ReaderSnapshot>,
}

/// The sending half of an entity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct WriterSnapshot {
    /// Whether it is reliable.
    pub reliable: bool,
    /// Whether it keeps samples for readers that come later.
    pub durable: bool,
    /// Samples that its QoS wants kept; `None` for all.
    pub depth: Option<usize>,
    /// Samples written.
    pub written: u64,
    /// Their bytes.
    pub written_bytes: u64,
    /// Readers it talks to.
    pub matched: usize,
    /// Readers of its topic it does not talk to because of their QoS.
    pub mismatched: usize,
}

/// The receiving half of an entity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ReaderSnapshot {
    /// Whether it is reliable.
    pub reliable: bool,
    /// Whether it wants samples that were written before it was created.
    pub durable: bool,
    /// Samples that its queue takes before the oldest is dropped; `None` if it wants all kept.
    pub depth: Option<usize>,
    /// 0 to 7, the most urgent.
    pub priority: u8,
    /// Whether the client has asked for samples.
    pub reading: bool,
    /// Samples that wait.
    pub queued: usize,
    /// Samples put into its queue.
    pub received: u64,
    /// Samples sent to the client.
    pub delivered: u64,
    /// Their bytes.
    pub delivered_bytes: u64,
    /// Samples dropped for want of room.
    pub dropped: u64,
    /// Samples dropped because their lifespan was over.
    pub expired: u64,
    /// Writers it hears.
    pub matched: usize,
    /// Writers of its topic it does not hear because of their QoS.
    pub mismatched: usize,
}

impl Snapshot {
    /// The time between two snapshots of an agent, to make rates of differences.
    #[must_use]
    pub fn seconds_since(&self, earlier: &Snapshot) -> f64 {
        self.at.saturating_sub(earlier.at) as f64 / 1e9
    }

    /// The client with this key, if it is there.
    #[must_use]
    pub fn client(&self, key: &str) -> Option<&ClientSnapshot> {
        self.clients.iter().find(|client| client.key == key)
    }
}
