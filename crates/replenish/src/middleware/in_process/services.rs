//! Services inside one process: requests are a topic of their own, replies go to the one reader
//! that the request's identity names.

use super::bus::Stored;
use super::{Bus, InProcess, Reader, SampleInfo, clock};
use crate::middleware::{
    EndpointSpec, Middleware, MiddlewareError, PublishError, ReaderId, RequestIdentity,
    ServiceSpec, WriterId,
};
use crate::platform::chain;
use crate::qos::{IngressLimit, Qos};
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
        type_hash: spec.type_hash,
        qos: spec.qos,
        max_size,
        ingress: IngressLimit::none(),
        keep_oldest: false,
    }
}

/// The receiver of a reply: participant, reader, and the stamp of that reader among those that had
/// its place.
#[derive(Clone, Copy)]
struct Addressee {
    participant: usize,
    reader: usize,
    stamp: u32,
}

impl Addressee {
    fn identity(self, number: u64) -> RequestIdentity {
        let mut guid = [0; 16];
        let (p, rest) = guid.split_at_mut(8);
        let (s, r) = rest.split_at_mut(4);
        p.copy_from_slice(&(self.participant as u64).to_be_bytes());
        s.copy_from_slice(&self.stamp.to_be_bytes());
        let reader = u32::try_from(self.reader).unwrap_or(u32::MAX);
        r.copy_from_slice(&reader.to_be_bytes());
        RequestIdentity::of(guid, number)
    }

    fn of(identity: &RequestIdentity) -> Option<Self> {
        let guid = identity.guid();
        let (p, rest) = guid.split_at(8);
        let (s, r) = rest.split_at(4);
        Some(Self {
            participant: usize::try_from(u64::from_be_bytes(p.try_into().ok()?)).ok()?,
            reader: usize::try_from(u32::from_be_bytes(r.try_into().ok()?)).ok()?,
            stamp: u32::from_be_bytes(s.try_into().ok()?),
        })
    }
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
        let writer = self.create_writer(&endpoint(spec, &nobody, spec.max_response));
        self.both(reader, writer)
    }

    pub(super) fn service_client(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        let nobody = alloc::format!("rr{}", spec.service);
        let reader = self.create_reader(&endpoint(spec, &nobody, spec.max_response))?;
        let topic = requests(spec);
        let writer = self.create_writer(&endpoint(spec, &topic, spec.max_request));
        let (reader, writer) = self.both(reader, writer)?;
        let mut bus = self.bus.state.lock();
        let mine = bus.me(self.me)?;
        let at = usize::from(reader.0);
        let stamp = mine.readers.get(at).map(|r| r.stamp);
        if let Some(writer) = mine.writers.get_mut(usize::from(writer.0)) {
            writer.replies = stamp.map(|stamp| (at, stamp));
        }
        Ok((reader, writer))
    }

    /// A reader does not stay without its writer.
    fn both(
        &self,
        reader: ReaderId,
        writer: Result<WriterId, MiddlewareError>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        if writer.is_err() {
            self.delete_reader(reader)?;
        }
        Ok((reader, writer?))
    }

    pub(super) fn send_request(
        &self,
        client: WriterId,
        payload: &[u8],
    ) -> Result<u64, PublishError> {
        let (wake, full, number) = {
            let mut bus = self.bus.state.lock();
            let mine = bus.participant_mut(self.me);
            let mine = mine.ok_or(PublishError::UnknownWriter)?;
            let writer = mine.writers.get_mut(usize::from(client.0));
            let writer = writer.ok_or(PublishError::UnknownWriter)?;
            let (reader, stamp) = writer.replies.ok_or(PublishError::UnknownWriter)?;
            // A client that was removed hears no replies, so it sends no requests.
            let replies = mine.readers.get(reader);
            let hears = |r: &&Reader| !r.deleted && r.stamp == stamp;
            replies.filter(hears).ok_or(PublishError::UnknownWriter)?;
            let to = Addressee {
                participant: self.me,
                reader,
                stamp,
            };
            let (size, limit) = (payload.len(), writer.limit);
            if size > limit {
                return Err(PublishError::TooLarge { size, limit });
            }
            writer.sent += 1;
            let (topic, number) = ((writer.topic, writer.offers), writer.sent);
            let info = SampleInfo {
                request: to.identity(number),
                sequence: Some(number),
                origins: chain::current(),
                ..SampleInfo::at(clock::monotonic())
            };
            let (wake, full) = bus.distribute(topic, payload, &info);
            (wake, full, number)
        };
        self.bus.ring(wake);
        if full {
            Err(PublishError::Full)
        } else {
            Ok(number)
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
            let mine = bus.participant(self.me);
            let writer = mine.and_then(|p| p.writers.get(usize::from(server.0)));
            let writer = writer.ok_or(PublishError::UnknownWriter)?;
            let (limit, offers) = (writer.limit, writer.offers);
            let size = payload.len();
            if size > limit {
                return Err(PublishError::TooLarge { size, limit });
            }
            let addressee = Addressee::of(to).ok_or(PublishError::LinkDown)?;
            let info = SampleInfo {
                request: RequestIdentity::reply(to.number()),
                origins: chain::current(),
                ..SampleInfo::at(clock::monotonic())
            };
            bus.bring((addressee, offers), payload, &info)?
        };
        self.bus.ring(wake);
        Ok(())
    }

    pub(super) fn knows_server(&self, client: WriterId) -> Option<bool> {
        let bus = self.bus.state.lock();
        let mine = bus.participant(self.me)?;
        let writer = mine.writers.get(usize::from(client.0))?;
        let replies = mine.readers.get(writer.replies?.0)?.requests;
        let mut servers = bus.topics.get(writer.topic)?.readers.iter();
        let served = servers.any(|(p, r)| {
            let reader = bus.participant(*p).and_then(|p| p.readers.get(*r));
            // A server has one quality of service for requests and replies.
            reader.is_some_and(|server| {
                let hears = writer.offers.check_offers(server.requests).is_ok();
                hears && server.requests.check_offers(replies).is_ok()
            })
        });
        Some(served)
    }
}

impl Bus {
    /// Stores a reply for one reader; the participants to wake.
    fn bring(
        &mut self,
        (to, offers): (Addressee, Qos),
        payload: &[u8],
        info: &SampleInfo,
    ) -> Result<u64, PublishError> {
        // A client that is gone is as a link that is down.
        let (p, r) = (to.participant, to.reader);
        let participant = self.participant_mut(p).ok_or(PublishError::LinkDown)?;
        let reader = participant.readers.get_mut(r);
        let reader = reader.filter(|r| !r.deleted && r.stamp == to.stamp);
        let reader = reader.ok_or(PublishError::LinkDown)?;
        if offers.check_offers(reader.requests).is_err() {
            return Ok(0); // they do not talk with each other; both were told
        }
        match reader.store(payload, info) {
            Stored::Waits => {}
            Stored::Lost => return Err(PublishError::Full),
            Stored::TooLong => return Ok(1 << p), // which tells it; as in DDS, the sender is not
        }
        let waits = participant.waits_for.as_ref();
        if waits.is_some_and(|i| i.contains(super::id(r))) {
            participant.waits_for = None;
            return Ok(1 << p);
        }
        Ok(0)
    }
}
