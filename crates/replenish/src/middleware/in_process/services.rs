//! Services inside one process: requests are a topic of their own, replies go to the one reader
//! that the request's identity names.

use super::{Bus, InProcess, SampleInfo, clock};
use crate::middleware::{
    EndpointSpec, Middleware, MiddlewareError, PublishError, ReaderId, RequestIdentity,
    ServiceSpec, WriterId,
};
use crate::qos::IngressLimit;
use alloc::string::String;

/// The topic of a service's requests; no ROS topic begins with `rq`.
fn requests(spec: &ServiceSpec<'_>) -> String {
    alloc::format!("rq{}", spec.service)
}

fn endpoint<'a>(spec: &ServiceSpec<'a>, topic: &'a str, max_size: usize) -> EndpointSpec<'a> {
    EndpointSpec {
        node: spec.node,
        topic,
        type_name: spec.type_name,
        dds_type_name: spec.request_type,
        qos: spec.qos,
        max_size,
        ingress: IngressLimit::none(),
    }
}

/// Who is to get the reply: participant and reader.
fn identity(participant: usize, reader: usize, number: u64) -> RequestIdentity {
    let mut guid = [0; 16];
    let (p, r) = guid.split_at_mut(8);
    p.copy_from_slice(&(participant as u64).to_be_bytes());
    r.copy_from_slice(&(reader as u64).to_be_bytes());
    RequestIdentity::of(guid, number)
}

fn addressee(identity: &RequestIdentity) -> Option<(usize, usize)> {
    let guid = identity.guid();
    let half = |bytes: Option<&[u8; 8]>| usize::try_from(u64::from_be_bytes(*bytes?)).ok();
    Some((half(guid.first_chunk())?, half(guid.last_chunk())?))
}

impl InProcess {
    pub(super) fn service_server(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        let topic = requests(spec);
        let reader = self.create_reader(&endpoint(spec, &topic, spec.max_request))?;
        // Replies are addressed, so the writer's topic has no readers.
        let nobody = alloc::format!("rr{}", spec.service);
        let writer = self.create_writer(&endpoint(spec, &nobody, spec.max_response))?;
        Ok((reader, writer))
    }

    pub(super) fn service_client(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        let nobody = alloc::format!("rr{}", spec.service);
        let reader = self.create_reader(&endpoint(spec, &nobody, spec.max_response))?;
        let topic = requests(spec);
        let writer = self.create_writer(&endpoint(spec, &topic, spec.max_request))?;
        let mut bus = self.bus.state.lock();
        let mine = &mut bus.me(self.me)?.writers;
        if let Some(writer) = mine.get_mut(usize::from(writer.0)) {
            writer.replies = Some(reader.0.into());
        }
        Ok((reader, writer))
    }

    pub(super) fn send_request(
        &self,
        client: WriterId,
        payload: &[u8],
    ) -> Result<u64, PublishError> {
        let (wake, full, number) = {
            let mut bus = self.bus.state.lock();
            let mine = bus.participants.get_mut(self.me);
            let writer = mine.and_then(|p| p.writers.get_mut(usize::from(client.0)));
            let writer = writer.ok_or(PublishError::UnknownWriter)?;
            let reader = writer.replies.ok_or(PublishError::UnknownWriter)?;
            let (size, limit) = (payload.len(), writer.limit);
            if size > limit {
                return Err(PublishError::TooLarge { size, limit });
            }
            writer.sent += 1;
            let (topic, number) = (writer.topic, writer.sent);
            let info = SampleInfo {
                request: identity(self.me, reader, number),
                sequence: Some(number),
                ..SampleInfo::at(clock::monotonic())
            };
            let (wake, full) = bus.distribute(topic, payload, &info);
            (wake, full, number)
        };
        self.bus.ring(wake);
        match full {
            true => Err(PublishError::Full),
            false => Ok(number),
        }
    }

    pub(super) fn send_reply(
        &self,
        server: WriterId,
        to: &RequestIdentity,
        payload: &[u8],
    ) -> Result<(), PublishError> {
        let wake = {
            let mut bus = self.bus.state.lock();
            let mine = bus.participants.get(self.me);
            let writer = mine.and_then(|p| p.writers.get(usize::from(server.0)));
            let limit = writer.ok_or(PublishError::UnknownWriter)?.limit;
            let size = payload.len();
            if size > limit {
                return Err(PublishError::TooLarge { size, limit });
            }
            let (p, r) = addressee(to).ok_or(PublishError::LinkDown)?;
            let info = SampleInfo {
                request: RequestIdentity::reply(to.number()),
                ..SampleInfo::at(clock::monotonic())
            };
            bus.bring(p, r, payload, &info)?
        };
        self.bus.ring(wake);
        Ok(())
    }

    pub(super) fn knows_server(&self, client: WriterId) -> Option<bool> {
        let bus = self.bus.state.lock();
        let mine = bus.participants.get(self.me)?;
        let topic = mine.writers.get(usize::from(client.0))?.topic;
        Some(!bus.topics.get(topic)?.readers.is_empty())
    }
}

impl Bus {
    /// Stores a reply for one reader; the participants to wake.
    fn bring(
        &mut self,
        p: usize,
        r: usize,
        payload: &[u8],
        info: &SampleInfo,
    ) -> Result<u64, PublishError> {
        // A client that is gone is as a link that is down.
        let participant = self.participants.get_mut(p).ok_or(PublishError::LinkDown)?;
        let reader = participant.readers.get_mut(r).filter(|r| !r.deleted);
        let reader = reader.ok_or(PublishError::LinkDown)?;
        if !reader.store(payload, info) {
            return Err(PublishError::Full);
        }
        let waits = participant.waits_for.as_ref();
        if waits.is_some_and(|i| i.contains(super::id(r))) {
            participant.waits_for = None;
            return Ok(1 << p);
        }
        Ok(0)
    }
}
