//! Making services, asking and answering.

use super::adapter::Rtps;
use super::new_end::NewEnd;
use super::service_end::{CYCLONE, HEAD, ServiceEnd, cyclone_head, cyclone_name};
use super::state::State;
use crate::middleware::{
    MiddlewareError, PublishError, ReaderId, RequestIdentity, ServiceSpec, WriterId,
};
use crate::qos::Qos;
use replenish_os::clock;
use replenish_rtps::endpoint::{Body, Header};
use replenish_rtps::participant as rtps;
use replenish_rtps::ros::Prefix;
use replenish_rtps::wire::{CDR_LE, Guid, Reader as Cdr, SampleIdentity};

impl Rtps {
    pub(super) fn set_up_server(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        let reader = end(spec, Prefix::Request, spec.request_type, spec.max_request);
        let writer = end(spec, Prefix::Reply, spec.response_type, spec.max_response);
        self.both(&reader, &writer, |_, _| ServiceEnd::server())
    }

    pub(super) fn set_up_client(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        let reader = end(spec, Prefix::Reply, spec.response_type, spec.max_response);
        let writer = end(spec, Prefix::Request, spec.request_type, spec.max_request);
        self.both(&reader, &writer, |own, writer| ServiceEnd::Client {
            own,
            writer,
            sent: 0,
        })
    }

    /// A reader and a writer; a reader does not stay without its writer.
    fn both(
        &self,
        reader: &NewEnd<'_>,
        writer: &NewEnd<'_>,
        service: impl FnOnce(Guid, Guid) -> ServiceEnd,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        let reader = self.add_reader(reader)?;
        let writer = match self.add_writer(writer) {
            Ok(writer) => writer,
            Err(error) => {
                self.remove_reader(reader);
                return Err(error);
            }
        };
        let state = &mut *self.state.lock();
        let prefix = state.participant.prefix();
        let asks = state.writers.get(usize::from(writer.0));
        let asks = asks.and_then(|end| end.id).map(rtps::WriterId::entity);
        let asks = Guid::new(prefix, asks.unwrap_or_default());
        if let Some(end) = state.readers.get_mut(usize::from(reader.0)) {
            let entity = end.id.map(rtps::ReaderId::entity).unwrap_or_default();
            end.service = Some(service(Guid::new(prefix, entity), asks));
        }
        if let Some(end) = state.writers.get_mut(usize::from(writer.0)) {
            end.partner = Some(reader);
        }
        Ok((reader, writer))
    }

    pub(super) fn send_request(
        &self,
        client: WriterId,
        payload: &[u8],
    ) -> Result<u64, PublishError> {
        let now = clock::monotonic();
        let mut guard = self.state.lock();
        let state = &mut *guard;
        let partner = state.partner(client)?;
        let cyclone = state.asks_cyclone(client);
        let service = state.readers.get_mut(usize::from(partner.0));
        let service = service.and_then(|end| end.service.as_mut());
        let Some(ServiceEnd::Client { own, sent, .. }) = service else {
            return Err(PublishError::UnknownWriter);
        };
        let (own, number) = (*own, sent.saturating_add(1));
        let head = cyclone_head(cyclone_name(own), number);
        let related = SampleIdentity {
            guid: own,
            sn: SampleIdentity::OWN,
        };
        let header = Header {
            related: (!cyclone).then_some(related),
            ..Header::default()
        };
        let head = if cyclone { head.as_slice() } else { &[] };
        let (id, _) = state.writer(client, payload.len())?;
        let body = Body::Parts(&[&CDR_LE, head, payload]);
        let written = state.write(id, body, header, now)?;
        let service = state.readers.get_mut(usize::from(partner.0));
        if let Some(ServiceEnd::Client { sent, .. }) = service.and_then(|end| end.service.as_mut())
        {
            *sent = written;
        }
        drop(guard);
        self.send_of(id, now);
        Ok(written)
    }

    pub(super) fn send_reply(
        &self,
        server: WriterId,
        to: &RequestIdentity,
        payload: &[u8],
    ) -> Result<(), PublishError> {
        let now = clock::monotonic();
        let mut guard = self.state.lock();
        let state = &mut *guard;
        let partner = state.partner(server)?;
        let bytes = to.guid();
        let guid = Guid::decode(&mut Cdr::new(&bytes, true));
        let guid = guid.map_err(|_| PublishError::LinkDown)?;
        let service = state.readers.get(usize::from(partner.0));
        let Some(ServiceEnd::Server { clients }) = service.and_then(|end| end.service.as_ref())
        else {
            return Err(PublishError::UnknownWriter);
        };
        let cyclone = clients.iter().find(|(writer, _)| *writer == guid);
        let head = cyclone.map(|(_, client)| cyclone_head(*client, to.number()));
        let related = SampleIdentity {
            guid,
            sn: i64::try_from(to.number()).unwrap_or(i64::MAX),
        };
        let header = Header {
            related: head.is_none().then_some(related),
            only: Some(guid.prefix),
            ..Header::default()
        };
        let head = head.as_ref().map_or(&[][..], |head| head.as_slice());
        let (id, _) = state.writer(server, payload.len())?;
        let body = Body::Parts(&[&CDR_LE, head, payload]);
        state.write(id, body, header, now)?;
        drop(guard);
        self.send_of(id, now);
        Ok(())
    }

    pub(super) fn knows_server(&self, client: WriterId) -> Option<bool> {
        // A thread that waits for a server may be the only one that looks after discovery.
        self.look_after_discovery();
        let state = self.state.lock();
        let partner = state.partner(client).ok()?;
        let writer = state.writers.get(usize::from(client.0))?.id?;
        let reader = state.readers.get(usize::from(partner.0))?.id?;
        Some(state.participant.has_counterpart(writer, reader))
    }
}

impl State {
    /// The reader at the same end of a service; none once it was removed.
    fn partner(&self, writer: WriterId) -> Result<ReaderId, PublishError> {
        let end = self.writers.get(usize::from(writer.0));
        let partner = end.and_then(|end| end.partner);
        partner.ok_or(PublishError::UnknownWriter)
    }

    /// Whether the server that a client has found is one of Cyclone.
    fn asks_cyclone(&self, client: WriterId) -> bool {
        let end = self.writers.get(usize::from(client.0));
        let writer = end.and_then(|end| self.participant.writer(end.id?));
        let server = writer.and_then(|writer| writer.readers().next());
        server.is_some_and(|server| {
            let mut known = self.participant.participants();
            known.any(|known| known.prefix == server.prefix && known.vendor == CYCLONE)
        })
    }
}

fn end<'a>(spec: &ServiceSpec<'a>, prefix: Prefix, ty: &'a str, max_size: usize) -> NewEnd<'a> {
    NewEnd {
        node: spec.node,
        name: spec.service,
        prefix,
        ty,
        type_hash: spec.type_hash,
        qos: Qos {
            deadline: None,
            lifespan: None,
            ..spec.qos
        },
        max_size,
        head: HEAD,
        keep_oldest: false,
    }
}
