//! The requests of clients in a session, submessage by submessage.

use super::state::{AgentCore, Now};
use crate::clients::ClientOrigin;
use crate::entities::{CreationContext, Delivery, MAX_DEFINITION};
use crate::flow::Guid;
use crate::report::Reason;
use replenish_xrce::SeqNum;
use replenish_xrce::wire::{
    BaseRequest, Body, Create, Delete, Header, Heartbeat, Message, ObjectId, ReadData, RequestId,
    Status, StatusReply, StreamId, Submessage, SubmessageId, Timestamp, TimestampReply, WireError,
    WireTime,
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

    /// One submessage of the client in slot `index`, which may be gone since an earlier one.
    pub(super) fn request(
        &mut self,
        now: Now,
        index: usize,
        stream: StreamId,
        submessage: &Submessage<'_>,
    ) {
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
                reader.request(delivery);
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
        self.answer_because(index, stream, read.base, status, limit);
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
        let mut context = CreationContext {
            limits: &self.limits,
            profiles: &self.profiles,
            rules: &self.rules,
            topics: &mut self.topics,
            guid: Guid::new(client.key, id, self.requesters, self.instance),
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
        if created.status == Status::OK {
            self.bridge_created(index, create);
            self.catch_up(now, index, id);
            self.notify_incompatible(index, id);
        }
        let limit = match created.status {
            Status::RESOURCES if size > MAX_DEFINITION => {
                Some(("bytes of a description", MAX_DEFINITION))
            }
            Status::RESOURCES => Some(("limits.entities", self.limits.entities)),
            _ => None,
        };
        self.answer_because(index, stream, create.base, created.status, limit);
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
            if let Some(key) = key
                && !self.replies.push(peer, header.session, key, &ok)
            {
                self.counters.replies_dropped.hit();
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
        if !self.replies.push(peer, header.session, key, &reply) {
            self.counters.replies_dropped.hit();
        }
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
        self.answer_because(index, stream, base, status, None);
    }

    /// The same for a refusal because of a limit.
    fn answer_because(
        &mut self,
        index: usize,
        stream: StreamId,
        base: BaseRequest,
        status: Status,
        limit: Option<(&'static str, usize)>,
    ) {
        if !status.is_ok() {
            self.counters.refused.hit();
            let object = base.object;
            let reason = Reason::Request {
                object,
                status,
                limit,
            };
            self.note_of(index, reason);
        }
        let reply = StatusReply {
            base,
            status,
            implementation: 0,
        };
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        if !status.is_ok() {
            self.refusals.note(client.key, base.object, status);
        }
        let queued = if stream == StreamId::NONE {
            self.replies
                .push(client.peer, client.session, client.key, &reply)
        } else {
            client.status(stream, reply, &self.limits)
        };
        if !queued {
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
