//! Services: a requester or a replier is a reader and a writer in one object.
//!
//! Names on DDS are those of ROS 2: requests of `/add` on `rq/addRequest`, replies on
//! `rr/addReply`.

use super::adapter::Xrce;
use super::backlog::Backlog;
use super::errors::{request_error, setting};
use super::objects::{Reader, State, Writer};
use super::state::stream;
use crate::Nanos;
use crate::middleware::{
    MiddlewareError, PublishError, ReaderId, RequestIdentity, ServiceSpec, WriterId,
};
use crate::name::concat;
use crate::platform::label;
use crate::qos::History;
use replenish_xrce::client::WriteError;
use replenish_xrce::wire::{
    DeliveryControl, Entity, ObjectId, ObjectKind, Representation, SampleIdentity, ServiceBinary,
};

impl Xrce {
    pub(super) fn set_up_service(
        &self,
        spec: &ServiceSpec<'_>,
        kind: ObjectKind,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        let (domain, most) = (self.settings.domain, self.settings.max_sample);
        let added = self.state.lock().add_service(spec, kind, domain, most);
        let (reader, writer, object) = added?;
        let confirmed = self.confirm(object, label("create a requester or replier"));
        if confirmed.is_err() {
            let state = &mut *self.state.lock();
            state.delete_reader(reader);
            state.delete_writer(writer);
        }
        confirmed.map(|()| (reader, writer))
    }

    /// Sends what `write` puts into the session.
    pub(super) fn send_service<T>(
        &self,
        now: Nanos,
        write: impl FnOnce(&mut State) -> Result<T, PublishError>,
    ) -> Result<T, PublishError> {
        let mut state = self.state.lock();
        let written = write(&mut state)?;
        // Reliable: what cannot be sent now stays in the session.
        state
            .flush(now, &*self.transport, self.waiting.alarm())
            .ok();
        drop(state);
        if self.transport.wants_write() {
            self.waiting.wake();
        }
        Ok(written)
    }
}

impl State {
    fn add_service(
        &mut self,
        spec: &ServiceSpec<'_>,
        kind: ObjectKind,
        domain: i16,
        most: usize,
    ) -> Result<(ReaderId, WriterId, ObjectId), MiddlewareError> {
        let stream = stream(true, spec.qos.criticality);
        let (incoming, outgoing) = match kind {
            ObjectKind::Requester => (spec.max_response, spec.max_request),
            _ => (spec.max_request, spec.max_response),
        };
        if !self.is_up() {
            return Err(MiddlewareError::LinkDown);
        }
        let limit = self.session.limit(stream).unwrap_or(0).min(most);
        let size = incoming.max(outgoing) + IDENTITY;
        if size > limit {
            return Err(MiddlewareError::TooLarge {
                size,
                limit,
                setting: setting(true),
            });
        }
        let (slot, number) = self.reader_place()?;
        let object = ObjectId::new(number, kind);
        let participant = self.participant(spec.node, domain)?;
        let request_topic = concat(&["rq", spec.service, "Request"]);
        let reply_topic = concat(&["rr", spec.service, "Reply"]);
        let repr = Representation::Binary(ServiceBinary {
            service: spec.service.trim_start_matches('/'),
            request_type: spec.request_type,
            reply_type: spec.response_type,
            request_topic: Some(&request_topic),
            reply_topic: Some(&reply_topic),
        });
        let entity = match kind {
            ObjectKind::Requester => Entity::Requester { repr, participant },
            _ => Entity::Replier { repr, participant },
        };
        self.create(object, &entity)?;
        self.session
            .read(object, stream, DeliveryControl::UNLIMITED)
            .map_err(|error| request_error(&error))?;
        let keep_last = spec.qos.history == History::KeepLast;
        let reader = Reader {
            object,
            topic: None,
            max_size: incoming,
            backlog: Backlog::new(spec.qos.depth.max(1), incoming, keep_last),
            lost: 0,
            flow: None,
            deleted: false,
        };
        let reader = self.place_reader(slot, reader);
        let writer = self.place_writer(Writer::new(object, None, stream, outgoing));
        Ok((reader, writer, object))
    }

    fn service_end(
        &self,
        end: WriterId,
        kind: ObjectKind,
        size: usize,
    ) -> Result<&Writer, PublishError> {
        let writer = self.endpoints.writers.get(usize::from(end.0));
        let writer = writer.filter(|w| w.object.kind() == Ok(kind) && !w.closed);
        let writer = writer.ok_or(PublishError::UnknownWriter)?;
        let limit = writer.max_size;
        if size > limit {
            Err(PublishError::TooLarge { size, limit })
        } else {
            Ok(writer)
        }
    }

    pub(super) fn request(&mut self, end: WriterId, payload: &[u8]) -> Result<u64, PublishError> {
        let writer = self.service_end(end, ObjectKind::Requester, payload.len())?;
        let (object, stream) = (writer.object, writer.stream);
        let sent = self.session.request(object, stream, payload);
        sent.map(|request| u64::from(request.0)).map_err(refused)
    }

    pub(super) fn reply(
        &mut self,
        end: WriterId,
        to: &RequestIdentity,
        payload: &[u8],
    ) -> Result<(), PublishError> {
        let writer = self.service_end(end, ObjectKind::Replier, payload.len())?;
        let (object, stream) = (writer.object, writer.stream);
        let identity = SampleIdentity(to.0);
        let sent = self.session.reply(object, stream, identity, payload);
        sent.map_err(refused)
    }
}

/// Bytes of a request or reply besides its payload.
const IDENTITY: usize = 24;

fn refused(error: WriteError) -> PublishError {
    match error {
        WriteError::WouldBlock => PublishError::Full,
        WriteError::TooLarge { size, limit } => PublishError::TooLarge { size, limit },
        WriteError::UnknownStream(_) => PublishError::UnknownWriter,
        _ => PublishError::LinkDown,
    }
}
