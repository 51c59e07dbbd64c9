//! Taking a [`Snapshot`].

use super::state::{AgentCore, Now};
use crate::clients::Client;
use crate::entities::{EntityRecord, Plan, Qos, Reader, Writer};
use crate::report::{
    ClientSnapshot, EntitySnapshot, ReaderSnapshot, Snapshot, StreamSnapshot, WriterSnapshot, hex,
};
use replenish_xrce::wire::{ObjectId, ObjectKind};
use std::fmt::Display;
use std::hash::Hash;

impl<P: Copy + Eq + Hash + Display> AgentCore<P> {
    /// The agent's state.
    #[must_use]
    pub fn snapshot(&self, now: Now) -> Snapshot {
        let mut clients: Vec<ClientSnapshot> = self
            .clients
            .iter()
            .map(|client| self.client(now, client))
            .collect();
        clients.sort_by(|a, b| a.key.cmp(&b.key));
        Snapshot {
            at: now.monotonic,
            stats: self.stats(),
            topics: self.topics.len(),
            queued_bytes: self.pool.used(),
            clients,
            refusals: self.refusals.snapshot(),
            bridge: None,
        }
    }

    fn client(&self, now: Now, client: &Client<P>) -> ClientSnapshot {
        let counts = client.counts;
        let outputs = client.outputs().iter();
        let entities = client.entities.iter();
        let mut entities: Vec<EntitySnapshot> = entities
            .map(|(id, record)| self.entity(id, record))
            .collect();
        entities.sort_by(|a, b| a.id.cmp(&b.id));
        ClientSnapshot {
            key: client.key.to_string(),
            session: client.session.0,
            peer: client.peer.to_string(),
            mtu: client.mtu,
            age: now.monotonic.saturating_sub(client.created),
            silent: now.monotonic.saturating_sub(client.heard),
            bytes: client.ledger.used(),
            datagrams_in: counts.datagrams_in,
            datagrams_out: counts.datagrams_out,
            bytes_in: counts.bytes_in,
            bytes_out: counts.bytes_out,
            rate_limited: counts.rate_limited,
            echoed: client.echo.is_shown(),
            streams: outputs
                .map(|output| StreamSnapshot {
                    stream: output.stream().0,
                    unacknowledged: output.unacknowledged(),
                    resent: output.resent(),
                })
                .collect(),
            entities,
        }
    }

    fn entity(&self, id: ObjectId, record: &EntityRecord) -> EntitySnapshot {
        let (domain, name, type_name) = match &record.plan {
            Plan::Participant { domain, name } => (*domain, &**name, ""),
            Plan::Group { domain } => (*domain, "", ""),
            Plan::Topic { key } | Plan::Writer { key, .. } | Plan::Reader { key, .. } => {
                (key.domain, &*key.name, &*key.type_name)
            }
            Plan::Requester { request, .. } | Plan::Replier { request, .. } => {
                (request.domain, &*request.name, &*request.type_name)
            }
        };
        EntitySnapshot {
            id: hex(id),
            kind: kind(id),
            domain,
            name: name.into(),
            type_name: type_name.into(),
            writer: record.writer.as_deref().map(|writer| self.writer(writer)),
            reader: record.reader.as_deref().map(|reader| self.reader(reader)),
        }
    }

    fn writer(&self, writer: &Writer) -> WriterSnapshot {
        let readers = self.topics.readers(writer.topic);
        let matched = readers.iter().filter(|r| writer.qos.serves(&r.qos)).count();
        WriterSnapshot {
            reliable: writer.qos.reliable,
            durable: writer.keeps(),
            depth: depth(&writer.qos),
            written: writer.written,
            written_bytes: writer.written_bytes,
            matched,
            mismatched: readers.len() - matched,
        }
    }

    fn reader(&self, reader: &Reader) -> ReaderSnapshot {
        let writers = self.topics.writers(reader.topic);
        let matched = writers.iter().filter(|w| w.qos.serves(&reader.qos)).count();
        ReaderSnapshot {
            reliable: reader.qos.reliable,
            durable: reader.qos.is_durable(),
            depth: depth(&reader.qos),
            priority: reader.service.priority,
            reading: reader.is_reading(),
            queued: reader.queued(),
            received: reader.counts.kept,
            delivered: reader.counts.delivered,
            delivered_bytes: reader.counts.delivered_bytes,
            dropped: reader.counts.dropped,
            expired: reader.counts.expired,
            matched,
            mismatched: writers.len() - matched,
        }
    }
}

/// The depth of the history, unless all is kept.
fn depth(qos: &Qos) -> Option<usize> {
    (!qos.keep_all).then_some(qos.depth)
}

fn kind(id: ObjectId) -> &'static str {
    match id.kind() {
        Ok(ObjectKind::Participant) => "participant",
        Ok(ObjectKind::Topic) => "topic",
        Ok(ObjectKind::Publisher) => "publisher",
        Ok(ObjectKind::Subscriber) => "subscriber",
        Ok(ObjectKind::DataWriter) => "data_writer",
        Ok(ObjectKind::DataReader) => "data_reader",
        Ok(ObjectKind::Requester) => "requester",
        Ok(ObjectKind::Replier) => "replier",
        _ => "other",
    }
}
