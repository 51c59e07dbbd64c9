//! [`Writer`]: sends samples and repairs what is lost (RTPS 2.5, 8.4.7 to 8.4.9).
//!
//! ```text
//!              write                    every reader has it
//!   (quiet) ──────────► announcing ──────────────────────────► (quiet)
//!                        │   ▲
//!   heartbeat: with a sample (`along`), 10 ms after the last write, then after twice the time, at
//!   most every second;
//!   an ACKNACK that asks for something: what it asks for is sent, the time begins anew
//! ```

use super::content::Content;
use super::history::{Body, Change, History};
use super::peer_reader::{Fragments, PeerReader};
use super::write::{Header, HostLimits, WriteError, WriterLimits};
use crate::wire::{
    AckNack, Durability, EntityId, Guid, GuidPrefix, INFINITE, NackFrag, Nanos, Qos, Reliability,
    SequenceNumber, SequenceSet, Timestamp,
};
use alloc::vec::Vec;
use core::net::SocketAddr;

const MILLISECOND: Nanos = 1_000_000;
/// Bytes of a datagram besides its fragment.
pub(crate) const DATAGRAM_HEAD: usize = 160;
/// From a write to the heartbeat after it.
pub(super) const FIRST_HEARTBEAT: Nanos = 10 * MILLISECOND;
/// Bytes of one burst of fragments to other hosts; bursts go out a millisecond apart: 64 MB/s.
const BURST: usize = 65_536;
const PAUSE: Nanos = MILLISECOND;
/// Between two bursts to readers on this host.
const HOST_PAUSE: Nanos = MILLISECOND / 10;

/// A writer with its history and its matched readers.
#[derive(Debug)]
pub struct Writer {
    pub(super) guid: Guid,
    qos: Qos,
    pub(super) history: History,
    pub(super) readers: Vec<PeerReader>,
    most_readers: usize,
    fragment: usize,
    host: HostLimits,
    /// All readers are on this host, and of this library.
    only_host: bool,
    pub(super) heartbeats: u32,
    pub(super) heartbeat_at: Nanos,
    /// When readers heard last of the samples that there are.
    pub(super) announced_at: Nanos,
    pub(super) pace: Nanos,
    pub(super) next_reader: usize,
    pub(super) burst: usize,
    pub(super) burst_ends: Nanos,
}

impl Writer {
    /// A writer without samples and readers. Memory is taken here and never again.
    #[must_use]
    pub fn new(guid: Guid, qos: Qos, limits: &WriterLimits) -> Self {
        Writer {
            guid,
            qos,
            history: History::new(limits.samples, limits.sample_bytes.max(4), limits.memory),
            readers: Vec::with_capacity(limits.readers.max(1)),
            most_readers: limits.readers.max(1),
            fragment: usize::from(limits.fragment_bytes.clamp(64, 65_000)),
            host: limits.host,
            only_host: true,
            heartbeats: 0,
            heartbeat_at: INFINITE,
            announced_at: 0,
            pace: FIRST_HEARTBEAT,
            next_reader: 0,
            burst: 0,
            burst_ends: 0,
        }
    }

    /// Its name.
    #[must_use]
    pub const fn guid(&self) -> Guid {
        self.guid
    }

    /// Its quality of service.
    #[must_use]
    pub const fn qos(&self) -> &Qos {
        &self.qos
    }

    /// Matched readers.
    #[must_use]
    pub const fn matched(&self) -> usize {
        self.readers.len()
    }

    /// Whether every reliable reader has every sample.
    #[must_use]
    pub fn is_acknowledged(&self) -> bool {
        let last = self.history.last();
        let mut reliable = self.readers.iter().filter(|reader| reader.reliable);
        reliable.all(|reader| reader.acked > last)
    }

    /// Whether a reliable reader of the participant `prefix` has everything up to `sn`.
    pub(crate) fn is_acknowledged_by(&self, prefix: GuidPrefix, sn: SequenceNumber) -> bool {
        let mut readers = self.readers.iter();
        readers.any(|reader| reader.reliable && reader.guid.prefix == prefix && reader.acked > sn)
    }

    /// Sends `payload`, with its encapsulation, to every matched reader. `source` is the time that
    /// it bears, of the wall clock.
    ///
    /// # Errors
    /// [`WriteError::TooLong`], [`WriteError::Full`].
    pub fn write(
        &mut self,
        payload: &[u8],
        source: Option<Timestamp>,
        now: Nanos,
    ) -> Result<SequenceNumber, WriteError> {
        let header = Header {
            source,
            ..Header::default()
        };
        self.write_with(Body::Parts(&[payload]), &header, now)
    }

    /// Sends a sample as `header` says.
    ///
    /// # Errors
    /// [`WriteError::TooLong`], [`WriteError::Full`].
    pub fn write_with(
        &mut self,
        body: Body<'_>,
        header: &Header,
        now: Nanos,
    ) -> Result<SequenceNumber, WriteError> {
        self.add(body, None, header, now)
    }

    /// Says that the endpoint or participant `gone` is no more.
    pub(crate) fn dispose(&mut self, gone: Guid, now: Nanos) -> SequenceNumber {
        self.forget_a_disposal();
        self.add(Body::Parts(&[]), Some(gone), &Header::default(), now)
            .unwrap_or(0)
    }

    /// Announces an instance of discovery. The announcement stays until it is forgotten.
    pub(crate) fn announce_instance(&mut self, bytes: &[u8], now: Nanos) -> SequenceNumber {
        self.forget_a_disposal();
        self.add(Body::Parts(&[bytes]), None, &Header::default(), now)
            .unwrap_or(0)
    }

    /// Makes room: discovery keeps as many disposals as there may be instances.
    fn forget_a_disposal(&mut self) {
        let full = self.history.is_full();
        if let Some(sn) = self.history.first_disposal().filter(|_| full) {
            self.history.remove(sn);
        }
    }

    fn add(
        &mut self,
        body: Body<'_>,
        gone: Option<Guid>,
        header: &Header,
        now: Nanos,
    ) -> Result<SequenceNumber, WriteError> {
        let (len, most) = (body.len(), self.history.size());
        if len > most {
            return Err(WriteError::TooLong { len, most });
        }
        self.expire(now);
        if self.is_full_for(len) {
            return Err(WriteError::Full);
        }
        let change = Change {
            source: header.source,
            related: header.related,
            origins: header.origins,
            only: header.only,
            shared: header.shared,
            written: now,
            fragment: self.fragment(),
            gone,
            ..Change::default()
        };
        let sn = self.history.add(change, body);
        if self.readers.iter().any(|reader| reader.reliable) {
            self.pace = FIRST_HEARTBEAT;
            self.heartbeat_at = self.heartbeat_at.min(now.saturating_add(FIRST_HEARTBEAT));
        }
        Ok(sn)
    }

    /// Whether the next sample is refused, since all are to be kept and a reader lacks the oldest.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.is_full_for(0)
    }

    fn is_full_for(&self, len: usize) -> bool {
        if self.qos.depth != 0 || !self.history.is_full_for(len) {
            return false;
        }
        let oldest = self.history.first();
        let lacks = |reader: &PeerReader| {
            reader.next <= oldest || (reader.reliable && reader.acked <= oldest)
        };
        self.readers.iter().any(lacks)
    }

    /// The bytes of a sample that is kept.
    pub(crate) fn kept(&self, sn: SequenceNumber) -> Option<&[u8]> {
        self.history.get(sn).map(|(_, bytes)| bytes)
    }

    /// The addresses of this host have changed.
    pub(crate) fn set_host(&mut self, host: HostLimits) {
        self.host = host;
        self.look_where_readers_are();
    }

    /// Forgets a sample; readers that lack it hear that it will not come.
    pub(crate) fn forget(&mut self, sn: SequenceNumber) {
        self.history.remove(sn);
    }

    pub(super) fn expire(&mut self, now: Nanos) {
        if self.qos.lifespan == INFINITE {
            return;
        }
        while let Some((change, _)) = self.history.get(self.history.first()) {
            if now.saturating_sub(change.written) < self.qos.lifespan {
                break;
            }
            self.history.remove(self.history.first());
        }
    }

    /// Matches a reader that is reached at `to`; `false` if there is no room for it. One that is
    /// known gets the new address.
    pub fn add_reader(&mut self, guid: Guid, qos: &Qos, to: SocketAddr, now: Nanos) -> bool {
        if let Some(known) = self.readers.iter_mut().find(|reader| reader.guid == guid) {
            known.to = to;
            self.look_where_readers_are();
            return true;
        }
        if self.readers.len() >= self.most_readers {
            return false;
        }
        self.expire(now);
        let reliable = self.qos.reliability == Reliability::Reliable
            && qos.reliability == Reliability::Reliable;
        let late = self.qos.durability >= Durability::TransientLocal
            && qos.durability >= Durability::TransientLocal;
        let next = self.history.last().saturating_add(1);
        // The request may be here before its client's reader of replies is known.
        let addressed = || self.history.first_addressed(guid.prefix).unwrap_or(next);
        let start = if late { 1 } else { addressed() };
        self.readers.push(PeerReader {
            guid,
            to,
            reliable,
            start,
            late,
            promised: start,
            next: start,
            fragment: 1,
            acked: start,
            requested: SequenceSet::empty(1),
            repair: None,
            ack_count: None,
            nack_frag_count: None,
            wants_heartbeat: reliable,
            asserts: false,
            fetches: false,
        });
        self.look_where_readers_are();
        if reliable && start < next {
            self.pace = FIRST_HEARTBEAT;
            self.heartbeat_at = self.heartbeat_at.min(now.saturating_add(FIRST_HEARTBEAT));
        }
        true
    }

    fn look_where_readers_are(&mut self) {
        // The room in sockets of other implementations is not known.
        let ours = |reader: &PeerReader| reader.guid.prefix.0.starts_with(&[0, 0]);
        let mut readers = self.readers.iter();
        self.only_host = readers.all(|reader| ours(reader) && self.host.has(reader.to));
    }

    /// Bytes of a fragment of the next sample.
    fn fragment(&self) -> usize {
        if self.only_host {
            usize::from(self.host.fragment_bytes.clamp(64, 65_000))
        } else {
            self.fragment
        }
    }

    /// Bytes of a datagram to this address, but for one fragment or sample alone.
    pub(crate) fn datagram(&self, to: SocketAddr) -> usize {
        if self.host.has(to) {
            usize::MAX
        } else {
            self.fragment.saturating_add(DATAGRAM_HEAD)
        }
    }

    /// Begins a burst of fragments.
    pub(super) fn begin_burst(&mut self) {
        self.burst = if self.only_host {
            self.host.burst
        } else {
            BURST
        };
    }

    /// A fragment has gone out.
    pub(super) fn pause(&mut self, fragment: usize, now: Nanos) {
        self.burst = self.burst.saturating_sub(fragment);
        let pause = if self.only_host { HOST_PAUSE } else { PAUSE };
        self.burst_ends = now.saturating_add(pause);
    }

    /// Every reader hears that this writer is alive.
    pub(crate) fn assert(&mut self) {
        for reader in &mut self.readers {
            reader.asserts = true;
        }
    }

    /// Forgets a reader; `false` if it was not matched.
    pub fn remove_reader(&mut self, guid: Guid) -> bool {
        let before = self.readers.len();
        self.readers.retain(|reader| reader.guid != guid);
        self.look_where_readers_are();
        before != self.readers.len()
    }

    /// Readers of the participant `prefix` are gone.
    pub(crate) fn remove_participant(&mut self, prefix: GuidPrefix) {
        self.readers.retain(|reader| reader.guid.prefix != prefix);
        self.look_where_readers_are();
    }

    /// The matched readers.
    pub fn readers(&self) -> impl Iterator<Item = Guid> + '_ {
        self.readers.iter().map(|reader| reader.guid)
    }

    /// Whether a reader of this participant is matched that has never said what it has.
    pub(crate) fn is_unheard_by(&self, prefix: GuidPrefix) -> bool {
        let unheard =
            |reader: &PeerReader| reader.guid.prefix == prefix && reader.ack_count.is_none();
        self.readers.iter().any(unheard)
    }

    /// A reader of `from` says what it has. Returns whether it begins anew: it had lost us for a
    /// while, or the ACKNACK was overtaken by a later one.
    pub fn acknack(&mut self, from: GuidPrefix, body: &AckNack, now: Nanos) -> bool {
        let guid = Guid::new(from, body.reader);
        let last = self.history.last();
        let found = self.readers.iter_mut().find(|reader| reader.guid == guid);
        let Some(reader) = found.filter(|reader| reader.reliable) else {
            return false;
        };
        let base = body.state.base.clamp(0, last.saturating_add(1));
        // A reader that had lost us counts from the beginning: a lower count is no older.
        let anew = base.max(1) < reader.acked;
        if reader.ack_count == Some(body.count) && !anew {
            return false;
        }
        reader.ack_count = Some(body.count);
        let begins = anew && !body.final_flag;
        if begins {
            // It hears what there is until it says that it has it.
            reader.promised = reader.acked;
            reader.acked = base.max(reader.start);
        } else {
            reader.acked = reader.acked.max(base);
        }
        // Samples that were not sent yet come by themselves.
        let mut requested = SequenceSet::empty(base);
        for sn in body.state.iter().filter(|sn| *sn < reader.next && *sn > 0) {
            requested.insert(sn);
        }
        reader.requested = requested;
        let lacks = reader.first_request().is_some();
        reader.wants_heartbeat |= !body.final_flag && !lacks;
        if lacks || begins {
            self.pace = FIRST_HEARTBEAT;
            self.heartbeat_at = self.heartbeat_at.min(now.saturating_add(FIRST_HEARTBEAT));
        } else if self.is_acknowledged() {
            self.heartbeat_at = INFINITE;
        }
        anew
    }

    /// A reader of `from` says which fragments it lacks.
    pub fn nack_frag(&mut self, from: GuidPrefix, body: &NackFrag, now: Nanos) {
        let guid = Guid::new(from, body.reader);
        let found = self.readers.iter_mut().find(|reader| reader.guid == guid);
        let Some(reader) = found.filter(|reader| reader.reliable) else {
            return;
        };
        if reader.nack_frag_count == Some(body.count) || body.sn >= reader.next {
            return;
        }
        reader.nack_frag_count = Some(body.count);
        if body.state.iter().next().is_some() {
            reader.repair = Some(Fragments {
                sn: body.sn,
                base: body.state.base,
                bits: Some(body.state.bits),
            });
            self.pace = FIRST_HEARTBEAT;
            self.heartbeat_at = self.heartbeat_at.min(now.saturating_add(FIRST_HEARTBEAT));
        }
    }

    /// The time at which [`Writer::transmit`] has something to say by itself.
    #[must_use]
    pub fn next_at(&self, now: Nanos) -> Nanos {
        self.contents_next_at(&[Content::New, Content::Repairs], now)
    }

    /// As [`next_at`](Self::next_at), for some contents alone.
    pub(crate) fn contents_next_at(&self, contents: &[Content], now: Nanos) -> Nanos {
        let mut readers = self.readers.iter();
        let ready = |reader| {
            contents
                .iter()
                .any(|content| self.is_ready(reader, *content))
        };
        let ready = if !readers.any(ready) {
            INFINITE
        } else if self.burst > 0 {
            now
        } else {
            now.max(self.burst_ends)
        };
        if contents.contains(&Content::New) {
            ready.min(self.heartbeat_at)
        } else {
            ready
        }
    }

    /// Whether there is something for this reader.
    pub(super) fn is_ready(&self, reader: &PeerReader, content: Content) -> bool {
        match content {
            Content::New => reader.next <= self.history.last() || reader.is_to_hear(),
            Content::Repairs => reader.lacks(),
        }
    }

    /// The entity to which an ACKNACK or `NACK_FRAG` for this writer goes.
    #[must_use]
    pub const fn entity(&self) -> EntityId {
        self.guid.entity
    }
}
