//! [`Participant`]: its state, and the calls of its owner.

use super::config::{ConfigError, EndpointSpec, ParticipantConfig};
use super::event::{Bound, Event};
use super::promises::{Assertions, Promises};
use super::remote::{RemoteEndpoint, RemoteParticipant, Text};
use super::status::EndpointStatus;
use crate::endpoint::{
    Body, DATAGRAM_HEAD, Header, HostLimits, Reader, ReaderLimits, Sample, WriteError, Writer,
    WriterLimits,
};
use crate::wire::{
    EndpointData, EntityId, Guid, GuidPrefix, Locators, Nanos, ParticipantData, Qos,
    SequenceNumber, Timestamp, TypeHash, Writer as Cdr, builtin, disposal,
};
use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec;
use alloc::vec::Vec;
use core::net::SocketAddr;

/// Bytes of the longest announcement of an endpoint of our own.
const OWN_BYTES: usize = 1100;
/// Of the longest assertion of liveliness that is taken.
const ASSERTION_BYTES: usize = 256;

/// A writer of a participant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct WriterId(pub(super) EntityId);

impl WriterId {
    /// Its name within the participant.
    #[must_use]
    pub const fn entity(self) -> EntityId {
        self.0
    }
}

/// A reader of a participant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ReaderId(pub(super) EntityId);

impl ReaderId {
    /// Its name within the participant.
    #[must_use]
    pub const fn entity(self) -> EntityId {
        self.0
    }
}

/// An own endpoint with what it is matched by.
#[derive(Debug)]
pub(super) struct Own<E> {
    pub(super) endpoint: E,
    pub(super) topic: Text,
    pub(super) type_name: Text,
    /// The number of its announcement.
    pub(super) announced: SequenceNumber,
    /// Its counts, but for its peers of this moment.
    pub(super) status: EndpointStatus,
    pub(super) promises: Promises,
}

/// Everything that one process has in a domain.
#[derive(Debug)]
pub struct Participant {
    pub(super) prefix: GuidPrefix,
    pub(super) domain: u32,
    pub(super) local: bool,
    pub(super) announcement: Box<[u8]>,
    pub(super) announce_to: Box<[SocketAddr]>,
    /// Where own endpoints are reached that name no address of their own.
    user: Locators,
    /// Where discovery is reached.
    discovery: Locators,
    pub(super) announced: u32,
    pub(super) announce_at: Nanos,
    /// How many of `announce_to`, and then of the participants, still get the announcement.
    pub(super) announce_left: usize,
    pub(super) announce_period: Nanos,
    pub(super) leaving: bool,
    pub(super) whole_graph: bool,
    /// Own endpoints of one topic are not matched with each other.
    apart: bool,
    pub(super) participants: Vec<RemoteParticipant>,
    pub(super) most_participants: usize,
    pub(super) remotes: Vec<RemoteEndpoint>,
    /// How many of them are not our own.
    pub(super) foreign: usize,
    pub(super) most_foreign: usize,
    pub(super) publications: (Writer, Reader),
    pub(super) subscriptions: (Writer, Reader),
    pub(super) writers: Vec<Own<Writer>>,
    pub(super) readers: Vec<Own<Reader>>,
    most_own: usize,
    matches: usize,
    fragment: u16,
    host: HostLimits,
    next_key: u32,
    events: VecDeque<Event>,
    most_events: usize,
    pub(super) next_writer: usize,
    /// Assertions of liveliness.
    pub(super) liveliness: (Writer, Reader),
    pub(super) assertions: Assertions,
    /// Some endpoint has a deadline or a lease.
    pub(super) timed: bool,
}

impl Participant {
    /// A participant that begins to announce itself. Memory for all that the limits allow is taken
    /// here; endpoints take theirs when they are made.
    ///
    /// # Errors
    /// [`ConfigError::Range`].
    pub fn new(config: &ParticipantConfig<'_>, now: Nanos) -> Result<Self, ConfigError> {
        config.check()?;
        let limits = &config.limits;
        let fragment =
            |datagram: usize| u16::try_from(datagram.saturating_sub(DATAGRAM_HEAD)).unwrap_or(1200);
        let host = HostLimits {
            fragment_bytes: fragment(config.host_datagram),
            burst: config.host_burst,
            addresses: config.user,
        };
        let fragment = fragment(config.datagram);
        let builtin = |writer: EntityId, reader: EntityId, bytes: usize| {
            let writer_limits = WriterLimits {
                samples: limits.own_endpoints.saturating_mul(2),
                sample_bytes: OWN_BYTES,
                readers: limits.participants,
                fragment_bytes: fragment,
                memory: None,
                host,
            };
            let reader_limits = ReaderLimits {
                samples: config.announcements,
                sample_bytes: bytes,
                writers: limits.participants,
            };
            (
                Writer::new(Guid::new(config.prefix, writer), BUILTIN, &writer_limits),
                Reader::new(Guid::new(config.prefix, reader), BUILTIN, &reader_limits),
            )
        };
        Ok(Participant {
            prefix: config.prefix,
            domain: config.domain,
            local: config.is_local(),
            announcement: announcement(config),
            announce_to: config.announce_to.into(),
            user: config.user,
            discovery: config.discovery,
            announced: 0,
            announce_at: now,
            announce_left: 0,
            announce_period: 3_000_000_000.min(config.lease / 3),
            leaving: false,
            whole_graph: config.whole_graph,
            apart: false,
            participants: Vec::with_capacity(limits.participants),
            most_participants: limits.participants,
            // Our own are among them.
            remotes: Vec::with_capacity(
                limits
                    .endpoints
                    .saturating_add(limits.own_endpoints.saturating_mul(2)),
            ),
            foreign: 0,
            most_foreign: limits.endpoints,
            publications: builtin(
                EntityId::SEDP_PUBLICATIONS_WRITER,
                EntityId::SEDP_PUBLICATIONS_READER,
                config.announcement_bytes,
            ),
            subscriptions: builtin(
                EntityId::SEDP_SUBSCRIPTIONS_WRITER,
                EntityId::SEDP_SUBSCRIPTIONS_READER,
                config.announcement_bytes,
            ),
            writers: Vec::with_capacity(limits.own_endpoints),
            readers: Vec::with_capacity(limits.own_endpoints),
            most_own: limits.own_endpoints,
            matches: limits.matches,
            fragment,
            host,
            next_key: 1,
            events: VecDeque::with_capacity(limits.events),
            most_events: limits.events,
            next_writer: 0,
            liveliness: builtin(
                EntityId::LIVELINESS_WRITER,
                EntityId::LIVELINESS_READER,
                ASSERTION_BYTES,
            ),
            assertions: Assertions::NONE,
            timed: false,
        })
    }

    /// Its name.
    #[must_use]
    pub const fn prefix(&self) -> GuidPrefix {
        self.prefix
    }

    /// Endpoints that are made from now on do not hear each other: their owner has another way
    /// between them.
    pub const fn keep_apart(&mut self) {
        self.apart = true;
    }

    /// Makes a writer and announces it.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn create_writer(
        &mut self,
        spec: &EndpointSpec<'_>,
        now: Nanos,
    ) -> Result<WriterId, ConfigError> {
        let (samples, topic, type_name) = checked(spec)?;
        if self.writers.len() >= self.most_own {
            return Err(ConfigError::Full);
        }
        let guid = Guid::new(self.prefix, EntityId::writer(self.take_key()));
        let limits = WriterLimits {
            samples,
            sample_bytes: spec.sample_bytes,
            readers: self.peers_of(spec),
            fragment_bytes: self.fragment,
            memory: spec.memory,
            host: self.host,
        };
        self.writers.push(Own {
            endpoint: Writer::new(guid, spec.qos, &limits),
            topic,
            type_name,
            announced: announce(&mut self.publications.0, guid, spec, now),
            status: EndpointStatus::default(),
            promises: Promises::of(&spec.qos),
        });
        self.promise(&spec.qos);
        self.plan_assertions(now);
        self.match_writer(guid.entity, now);
        self.meet_own(guid, spec, now);
        Ok(WriterId(guid.entity))
    }

    /// Makes a reader and announces it.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn create_reader(
        &mut self,
        spec: &EndpointSpec<'_>,
        now: Nanos,
    ) -> Result<ReaderId, ConfigError> {
        let (samples, topic, type_name) = checked(spec)?;
        if self.readers.len() >= self.most_own {
            return Err(ConfigError::Full);
        }
        let guid = Guid::new(self.prefix, EntityId::reader(self.take_key()));
        let mut spec = *spec;
        if spec.per_participant {
            spec.unicast = self.discovery;
        }
        let spec = &spec;
        let limits = ReaderLimits {
            samples,
            sample_bytes: spec.sample_bytes,
            writers: self.peers_of(spec),
        };
        self.readers.push(Own {
            endpoint: Reader::new(guid, spec.qos, &limits),
            topic,
            type_name,
            announced: announce(&mut self.subscriptions.0, guid, spec, now),
            status: EndpointStatus::default(),
            promises: Promises::of(&spec.qos),
        });
        self.promise(&spec.qos);
        self.match_reader(guid.entity, now);
        self.meet_own(guid, spec, now);
        Ok(ReaderId(guid.entity))
    }

    /// Own endpoints of one topic exchange samples like those of two participants: through the
    /// sockets.
    fn meet_own(&mut self, guid: Guid, spec: &EndpointSpec<'_>, now: Nanos) {
        if self.apart || spec.per_participant {
            return;
        }
        let data = EndpointData::new(guid, spec.topic, spec.type_name, spec.qos);
        let to = spec.unicast.best(self.local);
        let to = to.or_else(|| self.user.best(self.local));
        if let (Some(mut own), Some(to)) = (RemoteEndpoint::new(&data), to) {
            own.to = to;
            own.type_hash = spec.type_hash;
            self.learn(own, now);
        }
    }

    /// The most peers of an endpoint.
    fn peers_of(&self, spec: &EndpointSpec<'_>) -> usize {
        if spec.per_participant {
            self.matches.max(self.most_participants)
        } else {
            self.matches
        }
    }

    fn take_key(&mut self) -> u32 {
        let key = self.next_key;
        self.next_key = key.wrapping_add(1) & 0x00ff_ffff;
        key
    }

    /// Removes a writer; its peers hear of it.
    pub fn remove_writer(&mut self, id: WriterId, now: Nanos) {
        let Some(at) = self
            .writers
            .iter()
            .position(|own| own.endpoint.entity() == id.0)
        else {
            return;
        };
        let own = self.writers.swap_remove(at);
        self.plan_assertions(now);
        self.unlearn(own.endpoint.guid());
        dispose(
            &mut self.publications.0,
            own.endpoint.guid(),
            own.announced,
            now,
        );
    }

    /// Removes a reader; its peers hear of it.
    pub fn remove_reader(&mut self, id: ReaderId, now: Nanos) {
        let found = self
            .readers
            .iter()
            .position(|own| own.endpoint.guid().entity == id.0);
        let Some(at) = found else {
            return;
        };
        let own = self.readers.swap_remove(at);
        self.unlearn(own.endpoint.guid());
        dispose(
            &mut self.subscriptions.0,
            own.endpoint.guid(),
            own.announced,
            now,
        );
    }

    /// Sends a sample with more than its bytes; see [`Writer::write_with`].
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn write_with(
        &mut self,
        id: WriterId,
        body: Body<'_>,
        header: &Header,
        now: Nanos,
    ) -> Result<SequenceNumber, WriteError> {
        let mut writers = self.writers.iter_mut();
        let own = writers.find(|own| own.endpoint.entity() == id.0);
        let own = own.ok_or(WriteError::NoWriter)?;
        let written = own.endpoint.write_with(body, header, now)?;
        own.promises.written(now);
        Ok(written)
    }

    /// Sends a sample; see [`Writer::write`].
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn write(
        &mut self,
        id: WriterId,
        payload: &[u8],
        source: Option<Timestamp>,
        now: Nanos,
    ) -> Result<SequenceNumber, WriteError> {
        let header = Header {
            source,
            ..Header::default()
        };
        self.write_with(id, Body::Parts(&[payload]), &header, now)
    }

    /// Takes the next sample of a reader; see [`Reader::take`].
    pub fn take(&mut self, id: ReaderId) -> Option<Sample<'_>> {
        let found = self
            .readers
            .iter_mut()
            .find(|own| own.endpoint.guid().entity == id.0);
        found?.endpoint.take()
    }

    /// Takes the next sample of a reader in its buffer; see [`Reader::take_into`].
    pub fn take_into<'s>(&mut self, id: ReaderId, spare: &'s mut Box<[u8]>) -> Option<Sample<'s>> {
        let mut readers = self.readers.iter_mut();
        let found = readers.find(|own| own.endpoint.guid().entity == id.0);
        found?.endpoint.take_into(spare)
    }

    /// A reader whose next sample can be taken.
    #[must_use]
    pub fn next_ready(&self) -> Option<ReaderId> {
        let mut ready = self.readers.iter().filter(|own| own.endpoint.ready() > 0);
        ready.next().map(|own| ReaderId(own.endpoint.guid().entity))
    }

    /// The quality of service of an own writer or reader.
    #[must_use]
    pub fn own_qos(&self, entity: EntityId) -> Option<Qos> {
        let writer = self.writer(WriterId(entity)).map(Writer::qos);
        let qos = writer.or_else(|| self.reader(ReaderId(entity)).map(Reader::qos));
        qos.copied()
    }

    /// A writer, for its readers and what they have.
    #[must_use]
    pub fn writer(&self, id: WriterId) -> Option<&Writer> {
        let own = self
            .writers
            .iter()
            .find(|own| own.endpoint.entity() == id.0);
        own.map(|own| &own.endpoint)
    }

    /// A reader, for its writers and counts.
    #[must_use]
    pub fn reader(&self, id: ReaderId) -> Option<&Reader> {
        let own = self
            .readers
            .iter()
            .find(|own| own.endpoint.guid().entity == id.0);
        own.map(|own| &own.endpoint)
    }

    /// The participants that are known.
    pub fn participants(&self) -> impl Iterator<Item = &RemoteParticipant> {
        self.participants.iter()
    }

    /// The endpoints of others that are known.
    pub fn endpoints(&self) -> impl Iterator<Item = &RemoteEndpoint> {
        let own = self.prefix;
        self.remotes
            .iter()
            .filter(move |known| known.guid.prefix != own)
    }

    /// The endpoints that are known, our own included.
    pub fn all_endpoints(&self) -> impl Iterator<Item = &RemoteEndpoint> {
        self.remotes.iter()
    }

    /// Takes the oldest event.
    pub fn event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Keeps an event; the second newest place says that some were dropped.
    pub(super) fn report(&mut self, event: Event) {
        if self.events.len() >= self.most_events {
            self.events.pop_front();
            if let Some(oldest) = self.events.front_mut() {
                *oldest = Event::Full(Bound::Events);
            }
        }
        self.events.push_back(event);
    }

    /// Says goodbye with the next transmissions and announces itself no longer.
    pub fn leave(&mut self, now: Nanos) {
        let (mut qos, mut key) = ([0; 40], [0; 40]);
        let guid = Guid::new(self.prefix, EntityId::PARTICIPANT);
        if let Ok((_, key)) = disposal(guid, &mut qos, &mut key) {
            self.announcement = key.into();
        }
        self.leaving = true;
        self.announce_at = now;
    }
}

/// Endpoints of discovery are reliable and serve those who come late.
pub(super) const BUILTIN: Qos = Qos::latched(1);

fn checked(spec: &EndpointSpec<'_>) -> Result<(usize, Text, Text), ConfigError> {
    let samples = spec.check()?;
    let text = |text| Text::new(text).ok_or(ConfigError::Full);
    Ok((samples, text(spec.topic)?, text(spec.type_name)?))
}

/// The announcement of a participant with a name and an enclave of at most 128 bytes.
fn announcement(config: &ParticipantConfig<'_>) -> Box<[u8]> {
    let mut user_data = [0; 144];
    let mut w = Cdr::new(&mut user_data);
    w.put(b"enclave=");
    w.put(config.enclave.as_bytes());
    w.put(b";");
    let user_data = w.finish().unwrap_or(&[]);
    let data = ParticipantData {
        domain: Some(config.domain),
        metatraffic_unicast: config.discovery,
        default_unicast: config.user,
        lease: config.lease,
        name: config.name,
        user_data,
        builtin: builtin::DISCOVERY | builtin::LIVELINESS_WRITER | builtin::LIVELINESS_READER,
        ..ParticipantData::new(config.prefix)
    };
    encoded(768, |w| data.encode(w))
}

fn encoded(room: usize, write: impl FnOnce(&mut Cdr<'_>)) -> Box<[u8]> {
    let mut bytes = vec![0; room];
    let mut w = Cdr::new(&mut bytes);
    write(&mut w);
    w.finish().map(Box::from).unwrap_or_default()
}

/// Writes the announcement of an endpoint and returns its number.
fn announce(
    writer: &mut Writer,
    guid: Guid,
    spec: &EndpointSpec<'_>,
    now: Nanos,
) -> SequenceNumber {
    let user_data = spec.type_hash.as_ref().map(TypeHash::user_data);
    let mut data = EndpointData::new(guid, spec.topic, spec.type_name, spec.qos);
    data.user_data = user_data.as_ref().map_or(&[], |bytes| bytes.as_slice());
    data.unicast = spec.unicast;
    let bytes = encoded(OWN_BYTES, |w| data.encode(w));
    writer.announce_instance(&bytes, now)
}

/// Replaces the announcement by its disposal.
fn dispose(writer: &mut Writer, guid: Guid, announced: SequenceNumber, now: Nanos) {
    writer.forget(announced);
    writer.dispose(guid, now);
}
