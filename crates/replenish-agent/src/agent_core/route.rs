//! Routes samples from writers to readers: `WRITE_DATA`, and the history for readers that come
//! late.

use super::state::{AgentCore, Now};
use crate::entities::Address;
use crate::flow::{Identity, Sample, SampleInfo, TrackerHandle};
use crate::report::Reason;
use replenish_xrce::Nanos;
use replenish_xrce::wire::{ObjectId, ObjectKind, Status, StreamId, WriteData};
use std::hash::Hash;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// A client has written a sample, a request or a reply.
    pub(super) fn write(
        &mut self,
        now: Now,
        index: usize,
        stream: StreamId,
        write: &WriteData<'_>,
    ) {
        let at = now.monotonic;
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        let (id, key) = (write.base.object, client.key);
        let Some(writer) = client.entities.writer(id) else {
            self.answer(index, stream, write.base, Status::UNKNOWN_REFERENCE);
            return;
        };
        self.counters.samples_in.hit();
        writer.wrote(at, write.payload.len(), &self.counters);
        if writer.records {
            self.recordings.note(key, at, now.unix, write.payload);
        }
        let (topic, qos, keeps) = (writer.topic, writer.qos, writer.keeps());
        let mut info = SampleInfo {
            expires: qos.lifespan.map(|lifespan| at.saturating_add(lifespan)),
            ..SampleInfo::default()
        };
        let mut payload = write.payload;
        match id.kind() {
            Ok(ObjectKind::Requester) => {
                if let Some((identity, forgot)) = client.entities.call(id, write.base.request) {
                    info.request = Some(identity);
                    self.counters.calls_forgotten.add(forgot.into());
                }
            }
            Ok(ObjectKind::Replier) => {
                let Some((identity, reply)) = Identity::split(payload) else {
                    self.counters.malformed.hit();
                    return;
                };
                (info.reply_to, payload) = (Some(identity), reply);
            }
            _ => {}
        }
        let beyond = self.beyond(index, id);
        let repeats = stream.is_reliable() && qos.reliable && self.limits.confirm_timeout > 0;
        let returns = repeats && self.returns(at, index);
        let readers = self.topics.readers(topic);
        if readers.is_empty() && !keeps && !returns && beyond.is_none() {
            self.counters
                .replies_unwanted
                .add(info.reply_to.is_some().into());
            return;
        }
        let (bytes, limit) = (payload.len(), self.limits.sample);
        let fits = (bytes <= limit).then(|| Sample::new(payload, info, &self.pool));
        let Some(sample) = fits.flatten() else {
            self.counters.samples_refused.hit();
            let about = self.subject_of(index, id);
            let bytes = Some(bytes);
            self.note_of_about(index, Reason::Sample { bytes, limit }, about);
            return;
        };
        let mint = || self.confirmed.track((index, stream), at);
        if let Some(client) = self.clients.get_mut(index)
            && let Some(writer) = client.entities.writer(id)
        {
            if keeps {
                writer.keep(&sample, &client.ledger);
            }
            if returns {
                let tracker = self.tracker.get_or_insert_with(mint);
                writer.stash(&sample, tracker, self.limits.max_depth, &client.ledger);
                self.stashed = true;
            }
        }
        let mut taken = 0_u64;
        let mut short = None;
        let mut served = std::mem::take(&mut self.served);
        for reader in readers.iter().filter(|reader| qos.serves(&reader.qos)) {
            let Address { client, object } = reader.address;
            let Some(target) = self.clients.get_mut(client) else {
                continue;
            };
            let awaited = repeats
                && (returns || target.is_awaited(object, at, self.limits.confirm_timeout))
                && reader.qos.reliable;
            let tracker = awaited.then(|| &*self.tracker.get_or_insert_with(mint));
            let Some(endpoint) = target.entities.reader(object) else {
                continue;
            };
            if endpoint.offer(&sample, tracker, at, &target.ledger, &self.counters) {
                taken += 1;
            } else if !target.has_memory(bytes) {
                short = Some(client);
            }
            target.queue(object, at, &self.counters);
            if served.last() != Some(&client) {
                served.push(client);
            }
        }
        self.counters.samples_routed.add(taken);
        let is_reply = info.reply_to.is_some();
        match beyond {
            // A reply is for one only.
            Some(beyond) if taken == 0 || !is_reply => self.cross(beyond, &sample),
            None if is_reply && taken == 0 => self.counters.replies_unwanted.hit(),
            _ => {}
        }
        for client in served.drain(..) {
            self.serve(at, client);
        }
        self.served = served;
        if let Some(reader) = short {
            let limit = self.limits.client_bytes;
            let about = self.subject_of(index, id);
            self.note_of_about(reader, Reason::Memory { limit }, about);
        }
    }

    /// The first reader that has no room for a sample which has to reach it: writer and reader are
    /// reliable and keep all.
    pub(super) fn full_reader(
        &mut self,
        at: Nanos,
        index: usize,
        stream: StreamId,
        write: &WriteData<'_>,
    ) -> Option<Address> {
        if !stream.is_reliable() || write.payload.len() > self.limits.sample {
            return None;
        }
        let client = self.clients.get_mut(index)?;
        let writer = client.entities.writer(write.base.object)?;
        let (topic, qos) = (writer.topic, writer.qos);
        if !(qos.reliable && qos.keep_all) {
            return None;
        }
        let bytes = write.payload.len();
        for at_reader in 0.. {
            let reader = self.topics.readers(topic).get(at_reader)?;
            let address = reader.address;
            if qos.serves(&reader.qos) && self.holds_up(at, address, (bytes, false)) {
                return Some(address);
            }
        }
        None
    }

    /// Gives a new reader what durable writers of its topic have kept for it or, if its client has
    /// just returned from another agent, everything that other such clients have written since.
    pub(super) fn catch_up(&mut self, now: Now, index: usize, id: ObjectId) {
        let at = now.monotonic;
        let returns = self.returns(at, index);
        let client = self.clients.get_mut(index);
        let Some(reader) = client.and_then(|client| client.entities.reader(id)) else {
            return;
        };
        let (topic, qos) = (reader.topic, reader.qos);
        let returns = returns && qos.reliable;
        if !qos.is_durable() && !returns {
            return;
        }
        let writers = self.topics.writers(topic).iter();
        let addresses: Vec<Address> = writers
            .filter(|writer| writer.qos.is_durable() || returns)
            .filter(|writer| writer.qos.serves(&qos))
            .map(|writer| writer.address)
            .collect();
        for Address { client, object } in addresses {
            let writer = self
                .clients
                .get_mut(client)
                .and_then(|client| client.entities.writer(object));
            let history = writer.map(|writer| writer.for_late(at, qos.is_durable(), returns));
            let history: Vec<(Sample, Option<TrackerHandle>)> = history.unwrap_or_default();
            let Some(target) = self.clients.get_mut(index) else {
                return;
            };
            let Some(reader) = target.entities.reader(id) else {
                return;
            };
            for (sample, tracker) in history {
                let tracker = tracker.as_ref();
                if reader.offer(&sample, tracker, at, &target.ledger, &self.counters) {
                    self.counters.samples_routed.hit();
                }
            }
        }
    }
}
