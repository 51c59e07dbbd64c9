//! The requests of clients in a session, submessage by submessage.

use super::note::subject;
use super::state::{AgentCore, Now};
use crate::bridge::NameRefusal;
use crate::clients::ClientOrigin;
use crate::entities::{CreationContext, Delivery};
use crate::flow::Guid;
use crate::report::{Reason, Subject};
use replenish_xrce::SeqNum;
use replenish_xrce::wire::{
    BaseRequest, Body, Create, Delete, Header, Heartbeat, Message, ObjectId, ReadData, RequestId,
    Status, StatusReply, StreamId, Submessage, SubmessageId, Timestamp, TimestampReply, WireError,
    WireTime, WriteData,
};
use std::hash::Hash;

/// Bytes of request id and object id at the start of a request.
const BASE: usize = 4;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// All submessages of a message.
    pub(super) fn requests(
        &mut self,
        now: Now,
        index: usize,
        stream: StreamId,
        message: &Message<'_>,
    ) {
        for submessage in message.submessages() {
            match submessage {
                Ok(submessage) => self.request(now, index, stream, &submessage),
                Err(_) => {
                    self.counters.malformed.hit();
                    let bytes = message.body.len();
                    self.note_of(index, Reason::Malformed { bytes });
                }
            }
        }
    }

    /// Handles one submessage of the client in slot `index`, which may be gone since an earlier
    /// one. False if it is a sample that has to wait: nothing has been done with it.
    #[must_use]
    pub(super) fn take(
        &mut self,
        now: Now,
        index: usize,
        stream: StreamId,
        submessage: &Submessage<'_>,
    ) -> bool {
        if submessage.id == SubmessageId::Fragment {
            self.too_long(index, submessage.payload);
            return true;
        }
        if let Ok(Body::WriteData(write)) = submessage.body()
            && let Some(reader) = self.full_reader(now.monotonic, index, stream, &write)
        {
            self.block(index, stream, reader, write.payload.len());
            return false;
        }
        self.request(now, index, stream, submessage);
        true
    }

    /// The fragments of a submessage were too long together; `beginning` is what there was room
    /// for.
    fn too_long(&mut self, index: usize, beginning: &[u8]) {
        let Some((write, bytes)) = WriteData::of_beginning(beginning) else {
            self.counters.malformed.hit();
            let bytes = beginning.len();
            return self.note_of(index, Reason::Malformed { bytes });
        };
        self.counters.samples_refused.hit();
        let limit = self.limits.sample;
        let about = self.subject_of(index, write.base.object);
        self.note_of_about(index, Reason::Sample { bytes, limit }, about);
    }

    /// The same for one that need not wait.
    fn request(&mut self, now: Now, index: usize, stream: StreamId, submessage: &Submessage<'_>) {
        match submessage.body() {
            Ok(Body::WriteData(write)) => self.write(now, index, stream, &write),
            Ok(Body::AckNack(acknack)) => {
                if let Some(client) = self.clients.get_mut(index) {
                    client.acknowledge(now.monotonic, &acknack);
                }
            }
            Ok(Body::Heartbeat(heartbeat)) => self.heartbeat(index, stream, &heartbeat),
            Ok(Body::ReadData(read)) => self.read(now, index, stream, &read),
            Ok(Body::Create(create)) => {
                self.create(now, index, stream, &create, submessage.payload.len());
            }
            Ok(Body::Delete(delete)) => self.delete(index, stream, delete),
            Ok(Body::Timestamp(timestamp)) => self.timestamp(now, index, timestamp),
            Ok(Body::GetInfo(get)) => {
                if let Some((peer, header)) = self.peer_of(index) {
                    self.info(peer, &header, &get);
                }
            }
            Ok(_) => {
                self.counters.unsupported.hit();
                self.note_of(index, Reason::Unsupported);
            }
            Err(error) => self.unreadable(index, stream, submessage, error),
        }
    }

    fn read(&mut self, now: Now, index: usize, stream: StreamId, read: &ReadData<'_>) {
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        let at = now.monotonic;
        let delivery = Delivery::new(read.base, read.stream, read.control, at);
        let status = if client.entities.reader(read.base.object).is_none() {
            Status::UNKNOWN_REFERENCE
        } else if read.filter.is_some() {
            Status::INCOMPATIBLE
        } else if delivery.is_some() && read.stream == StreamId::NONE {
            Status::INVALID_DATA
        } else if delivery.is_some() && client.output(read.stream, &self.limits).is_none() {
            Status::RESOURCES
        } else {
            if let Some(reader) = client.entities.reader(read.base.object) {
                reader.request(delivery, stream);
            }
            client.queue(read.base.object, at, &self.counters);
            return; // granted: the samples are the answer
        };
        let client = self.clients.get_mut(index);
        let streams = client.map_or(0, |client| client.outputs().len());
        let limit = match status {
            Status::RESOURCES if streams >= self.limits.streams => {
                Some(("limits.streams", self.limits.streams))
            }
            Status::RESOURCES => Some(("limits.client_bytes", self.limits.client_bytes)),
            _ => None,
        };
        let about = self.subject_of(index, read.base.object);
        self.answer_because(index, stream, read.base, status, (limit, about));
    }

    fn heartbeat(&mut self, index: usize, stream: StreamId, heartbeat: &Heartbeat) {
        // Inside of a stream the named stream may be the one being read from; no client does that.
        if stream != StreamId::NONE || !heartbeat.stream.is_reliable() {
            self.counters.unsupported.hit();
            return;
        }
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        match client.take_input(heartbeat.stream, &self.limits) {
            Some(mut input) => {
                input.heartbeat(heartbeat.last);
                client.put_back(input);
            }
            None => self.counters.unsupported.hit(),
        }
    }

    fn create(
        &mut self,
        now: Now,
        index: usize,
        stream: StreamId,
        create: &Create<'_>,
        size: usize,
    ) {
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        let id = create.base.object;
        if matches!(client.origin, Some(ClientOrigin::Returned(_))) {
            self.recovery_window.note_creation(now.monotonic);
        }
        self.requesters = self.requesters.wrapping_add(1);
        let grant = client.grant.clone();
        let limits = grant
            .as_ref()
            .map_or(self.limits, |g| g.limits(&self.limits));
        let mut context = CreationContext {
            limits: &limits,
            grant: grant.as_deref(),
            profiles: &self.profiles,
            rules: &self.rules,
            topics: &mut self.topics,
            guid: Guid::new(client.key, id, self.requesters, self.instance),
            ledger: client.ledger.clone(),
        };
        let served = client.entities.answers(id);
        let created = client.entities.create(create, size, &mut context);
        if created.deleted {
            client.forget(id);
        }
        self.counters.qos_mismatches.add(created.mismatches as u64);
        if created.deleted {
            self.bridge_deleted(index, id);
            served.iter().for_each(|topic| self.notify_served(*topic));
        }
        if created.status == Status::OK
            && let Err(refusal) = self.bridge_admits(index, id)
        {
            let about = created.subject.map(subject);
            self.refuse_name(index, stream, create.base, (refusal, about));
            return;
        }
        if created.status == Status::OK {
            self.bridge_created(index, create);
            self.catch_up(now, index, id);
            self.notify_incompatible(index, id);
        }
        let refused = !created.status.is_ok();
        let about = created.subject.filter(|_| refused).map(subject);
        let why = (created.limit, about);
        self.answer_because(index, stream, create.base, created.status, why);
    }

    /// Takes back an entity whose topic name cannot cross to the other middleware.
    fn refuse_name(
        &mut self,
        index: usize,
        stream: StreamId,
        base: BaseRequest,
        (refusal, about): (NameRefusal, Option<Subject>),
    ) {
        if let Some(client) = self.clients.get_mut(index) {
            client.entities.delete(base.object, &mut self.topics);
            client.forget(base.object);
        }
        let (status, limit) = match refusal {
            NameRefusal::Full(what, limit) => (Status::RESOURCES, (what, limit)),
            NameRefusal::Type => {
                let what = "types of a topic name in DDS while endpoints use it";
                (Status::INCOMPATIBLE, (what, 1))
            }
        };
        self.answer_because(index, stream, base, status, (Some(limit), about));
    }

    fn delete(&mut self, index: usize, stream: StreamId, delete: Delete) {
        let id = delete.base.object;
        if id == ObjectId::CLIENT {
            let Some((peer, header)) = self.peer_of(index) else {
                return;
            };
            let key = self.clients.get_mut(index).map(|client| client.key);
            self.remove(index);
            let ok = StatusReply {
                base: delete.base,
                status: Status::OK,
                implementation: 0,
            };
            if let Some(key) = key {
                self.reply(peer, header.session, key, &ok);
            }
            return;
        }
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        let served = client.entities.answers(id);
        let deleted = client.entities.delete(id, &mut self.topics);
        client.forget(id);
        let status = if deleted {
            self.bridge_deleted(index, id);
            served.iter().for_each(|topic| self.notify_served(*topic));
            Status::OK
        } else {
            Status::UNKNOWN_REFERENCE
        };
        self.answer(index, stream, delete.base, status);
    }

    fn timestamp(&mut self, now: Now, index: usize, timestamp: Timestamp) {
        let Some((peer, header)) = self.peer_of(index) else {
            return;
        };
        let at = WireTime::from_nanos(now.unix);
        let reply = TimestampReply {
            transmit: at,
            receive: at,
            originate: timestamp.transmit,
        };
        let key = header
            .key
            .unwrap_or(replenish_xrce::wire::ClientKey([0; 4]));
        self.reply(peer, header.session, key, &reply);
    }

    /// Handles a submessage with a malformed body. A request is answered if its ids are readable.
    fn unreadable(
        &mut self,
        index: usize,
        stream: StreamId,
        submessage: &Submessage<'_>,
        error: WireError,
    ) {
        self.counters.malformed.hit();
        let request = matches!(submessage.id, SubmessageId::Create | SubmessageId::ReadData);
        let status = match error {
            WireError::UnknownKind(_) | WireError::UnknownRepresentation(_) => Status::INCOMPATIBLE,
            _ => Status::INVALID_DATA,
        };
        if let Some(&[r1, r2, o1, o2]) = submessage.payload.first_chunk::<BASE>()
            && request
        {
            let base = BaseRequest {
                request: RequestId(u16::from_be_bytes([r1, r2])),
                object: ObjectId::from_bytes([o1, o2]),
            };
            self.answer(index, stream, base, status);
        } else {
            let bytes = submessage.payload.len();
            self.note_of(index, Reason::Malformed { bytes });
        }
    }

    /// Answers a request on the stream it came on; outside of streams if it came there.
    pub(super) fn answer(
        &mut self,
        index: usize,
        stream: StreamId,
        base: BaseRequest,
        status: Status,
    ) {
        self.answer_because(index, stream, base, status, (None, None));
    }

    /// The same for a refusal because of a limit, or about a topic or node.
    fn answer_because(
        &mut self,
        index: usize,
        stream: StreamId,
        base: BaseRequest,
        status: Status,
        (limit, about): (Option<(&'static str, usize)>, Option<Subject>),
    ) {
        if !status.is_ok() {
            self.counters.refused.hit();
            let object = base.object;
            let reason = match status {
                Status::DENIED => Reason::Topic { object },
                status => Reason::Request {
                    object,
                    status,
                    limit,
                },
            };
            self.note_of_about(index, reason, about);
        }
        let reply = StatusReply {
            base,
            status,
            implementation: 0,
        };
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        if stream == StreamId::NONE {
            let (peer, session, key) = (client.peer, client.session, client.key);
            self.reply(peer, session, key, &reply);
        } else if !client.status(stream, reply, &self.limits) {
            self.counters.replies_dropped.hit();
        }
    }

    /// A client's address, and the header of its messages outside of streams.
    fn peer_of(&mut self, index: usize) -> Option<(P, Header)> {
        let client = self.clients.get_mut(index)?;
        let header = Header::new(client.session, StreamId::NONE, SeqNum(0), client.key);
        Some((client.peer, header))
    }
}
