//! The agent's activity, with rates: the model behind the table and the JSON.
//!
//! Rates are differences of two snapshots over the time between them; against the beginning if
//! there was none before.

use super::bridge_rows::BridgeRow;
use replenish_agent::{EntitySnapshot, Refusal, Snapshot, Stats};
use std::collections::BTreeMap;

/// The state at one time. The names are a contract.
#[derive(Debug, Clone, serde::Serialize)]
pub(crate) struct Status {
    /// The time that the rates are about.
    pub(crate) interval_seconds: f64,
    /// The clients, by key.
    pub(crate) clients: Vec<ClientRow>,
    /// The topics that have a writer or a reader, the busiest first.
    pub(crate) topics: Vec<TopicRow>,
    /// Every entity of every client; what both writes and reads (services) has both halves.
    pub(crate) entities: Vec<EntityRow>,
    /// The clients' nodes and endpoints in DDS; `None` without a bridge.
    pub(crate) bridge: Option<Vec<BridgeRow>>,
    /// The last log-ins, and the last requests, that were refused.
    pub(crate) refusals: Vec<RefusalRow>,
    /// Bytes of all samples that wait.
    pub(crate) queued_bytes: usize,
    /// All counters since the start.
    pub(crate) stats: Stats,
}

/// A log-in or request that was refused.
#[derive(Debug, Clone, serde::Serialize)]
pub(crate) struct RefusalRow {
    /// The client's key, and the entity's id; no id for a log-in.
    pub(crate) client: String,
    pub(crate) id: String,
    /// `/chatter`, the service, or the node; empty where the request does not say it.
    pub(crate) topic: String,
    /// `std_msgs/msg/String`.
    #[serde(rename = "type")]
    pub(crate) type_name: String,
    /// The answer.
    pub(crate) status: String,
    /// Why, as in the log.
    pub(crate) reason: String,
}

impl From<&Refusal> for RefusalRow {
    fn from(refusal: &Refusal) -> Self {
        Self {
            client: refusal.key.clone(),
            id: refusal.id.clone(),
            topic: refusal.name.clone(),
            type_name: refusal.type_name.clone(),
            status: refusal.status.clone(),
            reason: refusal.reason.clone(),
        }
    }
}

/// One client.
#[derive(Debug, Clone, serde::Serialize)]
pub(crate) struct ClientRow {
    pub(crate) key: String,
    pub(crate) session: u8,
    pub(crate) peer: String,
    pub(crate) mtu: usize,
    pub(crate) age_seconds: f64,
    pub(crate) silent_seconds: f64,
    pub(crate) entities: usize,
    /// Bytes it makes the agent keep.
    pub(crate) memory_bytes: usize,
    pub(crate) datagrams_in_per_second: f64,
    pub(crate) datagrams_out_per_second: f64,
    pub(crate) bytes_in_per_second: f64,
    pub(crate) bytes_out_per_second: f64,
    pub(crate) rate_limited: u64,
    /// Its address has shown that it receives.
    pub(crate) echoed: bool,
    pub(crate) retransmitted: u64,
    pub(crate) unacknowledged: usize,
}

/// One topic of one domain.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub(crate) struct TopicRow {
    pub(crate) domain: i16,
    pub(crate) topic: String,
    #[serde(rename = "type")]
    pub(crate) type_name: String,
    pub(crate) writers: usize,
    pub(crate) readers: usize,
    pub(crate) messages_in_per_second: f64,
    pub(crate) bytes_in_per_second: f64,
    pub(crate) messages_out_per_second: f64,
    pub(crate) bytes_out_per_second: f64,
    /// Samples dropped for want of room, and because their lifespan was over.
    pub(crate) dropped: u64,
}

/// One entity.
#[derive(Debug, Clone, serde::Serialize)]
pub(crate) struct EntityRow {
    /// The client's key.
    pub(crate) client: String,
    pub(crate) id: String,
    pub(crate) kind: &'static str,
    pub(crate) domain: i16,
    pub(crate) topic: String,
    #[serde(rename = "type")]
    pub(crate) type_name: String,
    pub(crate) writes: Option<Half>,
    pub(crate) reads: Option<Half>,
}

/// The traffic of an entity.
#[derive(Debug, Clone, serde::Serialize)]
pub(crate) struct Half {
    pub(crate) reliable: bool,
    pub(crate) durable: bool,
    /// `None`: everything is kept.
    pub(crate) depth: Option<usize>,
    /// Priority of a reader: 0 to 7, the most urgent.
    pub(crate) priority: Option<u8>,
    pub(crate) matched: usize,
    /// Number of entities of its topic that do not match it because of their QoS.
    pub(crate) mismatched: usize,
    pub(crate) messages: u64,
    pub(crate) bytes: u64,
    pub(crate) messages_per_second: f64,
    pub(crate) bytes_per_second: f64,
    pub(crate) queued: usize,
    pub(crate) dropped: u64,
    pub(crate) expired: u64,
}

impl Status {
    /// The figures of `now`; rates since `before`, or since `start` on the agent's clock.
    pub(crate) fn new(now: &Snapshot, before: Option<&Snapshot>, start: u64) -> Self {
        let seconds = match before {
            Some(before) => now.seconds_since(before),
            None => now.at.saturating_sub(start) as f64 / 1e9,
        };
        let rate = Rate(seconds.max(1e-3));
        let mut entities = Vec::new();
        let mut clients = Vec::new();
        for client in &now.clients {
            let earlier = before
                .and_then(|before| before.client(&client.key))
                // A client that has come back counts from zero.
                .filter(|earlier| earlier.session == client.session && earlier.age <= client.age);
            let was = |of: fn(&replenish_agent::ClientSnapshot) -> u64| earlier.map_or(0, of);
            clients.push(ClientRow {
                key: client.key.clone(),
                session: client.session,
                peer: client.peer.clone(),
                mtu: client.mtu,
                age_seconds: client.age as f64 / 1e9,
                silent_seconds: client.silent as f64 / 1e9,
                entities: client.entities.len(),
                memory_bytes: client.bytes,
                datagrams_in_per_second: rate.of(client.datagrams_in, was(|c| c.datagrams_in)),
                datagrams_out_per_second: rate.of(client.datagrams_out, was(|c| c.datagrams_out)),
                bytes_in_per_second: rate.of(client.bytes_in, was(|c| c.bytes_in)),
                bytes_out_per_second: rate.of(client.bytes_out, was(|c| c.bytes_out)),
                rate_limited: client.rate_limited,
                echoed: client.echoed,
                retransmitted: client.streams.iter().map(|s| s.resent).sum(),
                unacknowledged: client.streams.iter().map(|s| s.unacknowledged).sum(),
            });
            for entity in &client.entities {
                let earlier =
                    earlier.and_then(|client| client.entities.iter().find(|e| e.id == entity.id));
                entities.push(row(&client.key, entity, earlier, rate));
            }
        }
        Self {
            interval_seconds: seconds,
            clients,
            topics: topics(&entities),
            entities,
            bridge: now
                .bridge
                .as_deref()
                .map(|rows| rows.iter().map(BridgeRow::from).collect()),
            refusals: now.refusals.iter().map(RefusalRow::from).collect(),
            queued_bytes: now.queued_bytes,
            stats: now.stats,
        }
    }
}

/// Seconds, to divide by.
#[derive(Clone, Copy)]
struct Rate(f64);

impl Rate {
    fn of(self, now: u64, before: u64) -> f64 {
        now.saturating_sub(before) as f64 / self.0
    }
}

fn row(
    client: &str,
    entity: &EntitySnapshot,
    earlier: Option<&EntitySnapshot>,
    rate: Rate,
) -> EntityRow {
    let writes = entity.writer.map(|writer| {
        let before = earlier.and_then(|e| e.writer);
        let before = before.map_or((0, 0), |w| (w.written, w.written_bytes));
        Half {
            reliable: writer.reliable,
            durable: writer.durable,
            depth: writer.depth,
            priority: None,
            matched: writer.matched,
            mismatched: writer.mismatched,
            messages: writer.written,
            bytes: writer.written_bytes,
            messages_per_second: rate.of(writer.written, before.0),
            bytes_per_second: rate.of(writer.written_bytes, before.1),
            queued: 0,
            dropped: 0,
            expired: 0,
        }
    });
    let reads = entity.reader.map(|reader| {
        let before = earlier.and_then(|e| e.reader);
        let before = before.map_or((0, 0), |r| (r.delivered, r.delivered_bytes));
        Half {
            reliable: reader.reliable,
            durable: reader.durable,
            depth: reader.depth,
            priority: Some(reader.priority),
            matched: reader.matched,
            mismatched: reader.mismatched,
            messages: reader.delivered,
            bytes: reader.delivered_bytes,
            messages_per_second: rate.of(reader.delivered, before.0),
            bytes_per_second: rate.of(reader.delivered_bytes, before.1),
            queued: reader.queued,
            dropped: reader.dropped,
            expired: reader.expired,
        }
    });
    EntityRow {
        client: client.into(),
        id: entity.id.clone(),
        kind: entity.kind,
        domain: entity.domain,
        topic: entity.name.clone(),
        type_name: entity.type_name.clone(),
        writes,
        reads,
    }
}

/// Sums by topic. A service goes by the topic of its requests.
fn topics(entities: &[EntityRow]) -> Vec<TopicRow> {
    let mut topics: BTreeMap<(i16, &str, &str), TopicRow> = BTreeMap::new();
    for entity in entities {
        if entity.writes.is_none() && entity.reads.is_none() {
            continue;
        }
        let key = (entity.domain, &*entity.topic, &*entity.type_name);
        let topic = topics.entry(key).or_insert_with(|| TopicRow {
            domain: entity.domain,
            topic: entity.topic.clone(),
            type_name: entity.type_name.clone(),
            ..TopicRow::default()
        });
        if let Some(half) = &entity.writes {
            topic.writers += 1;
            topic.messages_in_per_second += half.messages_per_second;
            topic.bytes_in_per_second += half.bytes_per_second;
        }
        if let Some(half) = &entity.reads {
            topic.readers += 1;
            topic.messages_out_per_second += half.messages_per_second;
            topic.bytes_out_per_second += half.bytes_per_second;
            topic.dropped += half.dropped + half.expired;
        }
    }
    let mut topics: Vec<TopicRow> = topics.into_values().collect();
    let busy = |topic: &TopicRow| topic.messages_in_per_second + topic.messages_out_per_second;
    topics.sort_by(|a, b| busy(b).total_cmp(&busy(a)));
    topics
}
