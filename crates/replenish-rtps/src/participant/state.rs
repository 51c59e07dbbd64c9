//! [`Participant`]: its state, and the calls of its owner.

use super::announcements::{OWN_BYTES, QUICK, announcement};
use super::config::{ConfigError, ParticipantConfig};
use super::event::{Bound, Event};
use super::promises::{Assertions, Promises};
use super::remote::{RemoteEndpoint, RemoteParticipant, Text};
use super::status::EndpointStatus;
use crate::endpoint::{
    Body, DATAGRAM_HEAD, Header, HostLimits, Reader, ReaderLimits, Sample, WriteError, Writer,
    WriterLimits,
};
use crate::wire::{
    EntityId, Guid, GuidPrefix, Locators, Nanos, Qos, Reach, SequenceNumber, Timestamp, disposal,
};
use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::net::SocketAddr;

/// Bytes of the longest assertion of liveliness that is taken.
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
    /// Its addresses are to be announced anew.
    pub(super) moved: bool,
}

/// Everything that one process has in a domain.
#[derive(Debug)]
pub struct Participant {
    pub(super) prefix: GuidPrefix,
    pub(super) domain: u32,
    pub(super) reach: Reach,
    pub(super) announcement: Vec<u8>,
    pub(super) announce_to: Box<[SocketAddr]>,
    /// Where own endpoints are reached that name no address of their own.
    pub(super) user: Locators,
    /// Where discovery is reached.
    pub(super) discovery: Locators,
    pub(super) announced: u32,
    /// Announcements with lower numbers come quickly after each other.
    pub(super) quick_until: u32,
    pub(super) announce_at: Nanos,
    /// How many of `announce_to`, and then of the participants, still get the announcement.
    pub(super) announce_left: usize,
    /// The addresses beyond this host that peers were told last.
    pub(super) abroad: Vec<SocketAddr>,
    pub(super) announce_period: Nanos,
    pub(super) leaving: bool,
    pub(super) whole_graph: bool,
    /// An endpoint that fits has no place.
    pub(super) is_crowded: bool,
    /// Own endpoints of one topic are not matched with each other.
    pub(super) apart: bool,
    pub(super) participants: Vec<RemoteParticipant>,
    /// The place of the one that was heard last.
    pub(super) heard_last: usize,
    pub(super) most_participants: usize,
    pub(super) remotes: Vec<RemoteEndpoint>,
    /// Their names, in the same order: a search looks at nothing else.
    pub(super) known: Vec<Guid>,
    /// How many of them are not our own.
    pub(super) foreign: usize,
    pub(super) most_foreign: usize,
    pub(super) publications: (Writer, Reader),
    pub(super) subscriptions: (Writer, Reader),
    pub(super) writers: Vec<Own<Writer>>,
    pub(super) readers: Vec<Own<Reader>>,
    pub(super) most_own: usize,
    pub(super) matches: usize,
    pub(super) fragment: u16,
    pub(super) host: HostLimits,
    pub(super) next_key: u32,
    pub(super) events: VecDeque<Event>,
    pub(super) most_events: usize,
    pub(super) next_writer: usize,
    /// Assertions of liveliness.
    pub(super) liveliness: (Writer, Reader),
    pub(super) assertions: Assertions,
    /// Some endpoint has a deadline or a lease.
    pub(super) timed: bool,
    /// Samples may wait to be fetched.
    pub(super) referred: bool,
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
        // Our own are among them.
        let own = limits.own_endpoints.saturating_mul(2);
        let endpoints = limits.endpoints.saturating_add(own);
        let builtin = |writer: EntityId, reader: EntityId, samples: usize, bytes: usize| {
            let writer_limits = WriterLimits {
                samples,
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
            reach: Reach::of(&config.discovery),
            announcement: announcement(config),
            announce_to: config.announce_to.into(),
            user: config.user,
            discovery: config.discovery,
            announced: 0,
            quick_until: QUICK,
            announce_at: now,
            announce_left: 0,
            abroad: Vec::new(),
            announce_period: 3_000_000_000.min(config.lease / 3),
            leaving: false,
            whole_graph: config.whole_graph,
            is_crowded: false,
            apart: false,
            participants: Vec::with_capacity(limits.participants),
            heard_last: 0,
            most_participants: limits.participants,
            remotes: Vec::with_capacity(endpoints),
            known: Vec::with_capacity(endpoints),
            foreign: 0,
            most_foreign: limits.endpoints,
            publications: builtin(
                EntityId::SEDP_PUBLICATIONS_WRITER,
                EntityId::SEDP_PUBLICATIONS_READER,
                own,
                config.announcement_bytes,
            ),
            subscriptions: builtin(
                EntityId::SEDP_SUBSCRIPTIONS_WRITER,
                EntityId::SEDP_SUBSCRIPTIONS_READER,
                own,
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
                1, // the last assertion
                ASSERTION_BYTES,
            ),
            assertions: Assertions::NONE,
            timed: false,
            referred: false,
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

    /// Whether an event waits.
    #[must_use]
    pub fn has_event(&self) -> bool {
        !self.events.is_empty()
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
