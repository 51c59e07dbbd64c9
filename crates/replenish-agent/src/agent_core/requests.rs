//! What clients ask for in a session, submessage by submessage.

use super::{AgentCore, Now};
use crate::entities::Request;
use replenish_xrce::SeqNum;
use replenish_xrce::wire::{
    BaseRequest, Body, Create, Delete, Header, Heartbeat, ObjectId, ReadData, RequestId, Status,
    StatusReply, StreamId, Submessage, SubmessageId, Submessages, Timestamp, TimestampReply,
    WireError, WireTime, WriteData,
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
        submessages: Submessages<'_>,
    ) {
        for submessage in submessages {
            match submessage {
                Ok(submessage) => self.request(now, index, stream, &submessage),
                Err(_) => self.counters.malformed.hit(),
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
            Ok(Body::WriteData(write)) => self.write(index, stream, &write),
            Ok(Body::AckNack(acknack)) => {
                if let Some(client) = self.clients.get_mut(index) {
                    client.acknowledge(now.monotonic, &acknack);
                }
            }
            Ok(Body::Heartbeat(heartbeat)) => self.heartbeat(index, stream, &heartbeat),
            Ok(Body::ReadData(read)) => self.read(index, stream, &read),
            Ok(Body::Create(create)) => {
                let definition = submessage.payload.get(BASE..).unwrap_or_default();
                self.create(index, stream, &create, definition);
            }
            Ok(Body::Delete(delete)) => self.delete(index, stream, delete),
            Ok(Body::Timestamp(timestamp)) => self.timestamp(now, index, timestamp),
            Ok(Body::GetInfo(get)) => {
                if let Some((peer, header)) = self.origin(index) {
                    self.info(peer, &header, &get);
                }
            }
            Ok(_) => self.counters.unsupported.hit(),
            Err(error) => self.unreadable(index, stream, submessage, error),
        }
    }

    fn write(&mut self, index: usize, stream: StreamId, write: &WriteData<'_>) {
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        let Some(writer) = client.entities.writer(write.base.object) else {
            self.answer(index, stream, write.base, Status::UNKNOWN_REFERENCE);
            return;
        };
        self.counters.samples_in.hit();
        let readers = self.topics.readers(writer.topic);
        if readers.is_empty() {
            return;
        }
        let sample = if write.payload.len() <= self.limits.sample {
            self.pool.sample(write.payload)
        } else {
            None
        };
        let Some(sample) = sample else {
            self.counters.samples_refused.hit();
            return;
        };
        for address in readers {
            let Some(client) = self.clients.get_mut(address.client) else {
                continue;
            };
            let Some(reader) = client.entities.reader(address.reader) else {
                continue;
            };
            self.counters.samples_routed.hit();
            if reader.push(sample.clone()) {
                self.counters.samples_dropped.hit();
            }
            client.queue(address.reader);
            if !client.queued {
                client.queued = true;
                self.line.push_back(address.client);
            }
        }
    }

    fn read(&mut self, index: usize, stream: StreamId, read: &ReadData<'_>) {
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        let request = Request::new(read.base, read.stream, read.control);
        let status = if client.entities.reader(read.base.object).is_none() {
            Status::UNKNOWN_REFERENCE
        } else if read.filter.is_some() {
            Status::INCOMPATIBLE
        } else if request.is_some() && read.stream == StreamId::NONE {
            Status::INVALID_DATA
        } else if request.is_some() && client.outlet(read.stream, &self.limits).is_none() {
            Status::RESOURCES
        } else {
            if let Some(reader) = client.entities.reader(read.base.object) {
                reader.request(request);
            }
            client.queue(read.base.object);
            return; // granted: the samples are the answer
        };
        self.answer(index, stream, read.base, status);
    }

    fn heartbeat(&mut self, index: usize, stream: StreamId, heartbeat: &Heartbeat) {
        // Inside of a stream the named stream may be the one being read from; nobody does that.
        if stream != StreamId::NONE || !heartbeat.stream.is_reliable() {
            self.counters.unsupported.hit();
            return;
        }
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        match client.take_inlet(heartbeat.stream, &self.limits) {
            Some(mut inlet) => {
                inlet.heartbeat(heartbeat.last);
                client.put_back(inlet);
            }
            None => self.counters.unsupported.hit(),
        }
    }

    fn create(&mut self, index: usize, stream: StreamId, create: &Create<'_>, definition: &[u8]) {
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        let (status, deleted) =
            client
                .entities
                .create(create, definition, &mut self.topics, &self.limits);
        client.forget(&deleted);
        self.answer(index, stream, create.base, status);
    }

    fn delete(&mut self, index: usize, stream: StreamId, delete: Delete) {
        let id = delete.base.object;
        if id == ObjectId::CLIENT {
            let Some((peer, header)) = self.origin(index) else {
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
        let deleted = client.entities.delete(id, &mut self.topics);
        client.forget(&deleted);
        let status = if deleted.is_empty() {
            Status::UNKNOWN_REFERENCE
        } else {
            Status::OK
        };
        self.answer(index, stream, delete.base, status);
    }

    fn timestamp(&mut self, now: Now, index: usize, timestamp: Timestamp) {
        let Some((peer, header)) = self.origin(index) else {
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

    /// A submessage whose body makes no sense. A request is answered if it says which one it is.
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
        }
    }

    /// Answers a request on the stream it came on; outside of streams if it came there.
    fn answer(&mut self, index: usize, stream: StreamId, base: BaseRequest, status: Status) {
        if !status.is_ok() {
            self.counters.refused.hit();
        }
        let reply = StatusReply {
            base,
            status,
            implementation: 0,
        };
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
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

    /// Where a client is, and the header its messages outside of streams have.
    fn origin(&mut self, index: usize) -> Option<(P, Header)> {
        let client = self.clients.get_mut(index)?;
        let header = Header::new(client.session, StreamId::NONE, SeqNum(0), client.key);
        Some((client.peer, header))
    }
}
