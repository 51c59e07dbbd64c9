//! [`Reader`]: takes samples in, in order and once, and asks for lost ones (RTPS 2.5, 8.4.10 to
//! 8.4.12).
//!
//! ```text
//!   DATA ──► in order? ──yes──► ready ──► take
//!               │ no                 ▲
//!               ▼                    │ the missing ones came, or a GAP, or a HEARTBEAT that
//!              held ─────────────────┘ begins later
//!
//!   HEARTBEAT ──► ACKNACK (missing samples), NACK_FRAG (missing fragments)
//! ```
//!
//! A reader has no timers: a writer repeats its heartbeat until everything is acknowledged.

use super::peer_writer::{CYCLONE, PeerWriter};
use super::store::{Slot, State, Store};
use crate::wire::{
    ChainOrigins, Durability, Guid, GuidPrefix, INFINITE, LivelinessKind, Nanos, Qos, Reliability,
    SampleIdentity, SequenceNumber, Timestamp,
};
use alloc::boxed::Box;
use alloc::vec::Vec;
use core::net::SocketAddr;

/// The memory of a reader.
#[derive(Clone, Copy, Debug)]
pub struct ReaderLimits {
    /// Samples that wait to be read or for an earlier one, from 1.
    pub samples: usize,
    /// Bytes of the longest sample with its encapsulation, from 4.
    pub sample_bytes: usize,
    /// Matched writers, from 1.
    pub writers: usize,
}

/// Counts of a reader, from its creation on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReaderStats {
    /// Samples that became ready to be read.
    pub received: u64,
    /// Samples that came again.
    pub duplicates: u64,
    /// Samples that were overwritten before they were read.
    pub overwritten: u64,
    /// Samples of reliable writers that will not come: their writers had them no longer. Samples
    /// that a late reader was not promised do not count.
    pub lost: u64,
    /// Samples that are longer than the limit, or in more fragments than it allows.
    pub too_long: u64,
    /// Samples that found no room and are asked for again.
    pub refused: u64,
}

/// A sample that was received.
#[derive(Clone, Copy, Debug)]
pub struct Sample<'a> {
    /// Its bytes, with the encapsulation; the key if the instance is gone.
    pub payload: &'a [u8],
    /// Its writer.
    pub writer: Guid,
    /// Its number.
    pub sn: SequenceNumber,
    /// The time of the writer's wall clock that it bears.
    pub source: Option<Timestamp>,
    /// The instance of which it says that it is gone.
    pub gone: Option<Guid>,
    /// The request that it belongs to, as its writer says.
    pub related: Option<SampleIdentity>,
    /// The chains that led to it, as its writer says.
    pub origins: ChainOrigins,
    /// Time in ns after its source's time for which it is of use.
    pub lifespan: Nanos,
}

const fn sample<'s>(slot: &Slot, payload: &'s [u8]) -> Sample<'s> {
    Sample {
        payload,
        writer: slot.writer,
        sn: slot.sn,
        source: slot.source,
        gone: slot.gone,
        related: slot.related,
        origins: slot.origins,
        lifespan: slot.lifespan,
    }
}

/// A reader with its samples and its matched writers.
#[derive(Debug)]
pub struct Reader {
    pub(super) guid: Guid,
    pub(super) qos: Qos,
    pub(super) store: Store,
    pub(super) writers: Vec<PeerWriter>,
    /// Writers that were matched, the latest at the end; each may come back.
    past: Vec<PeerWriter>,
    most_writers: usize,
    pub(super) next_writer: usize,
    /// ACKNACKs and `NACK_FRAG`s to all writers: one that was lost and is met again may never have
    /// lost this reader, and ignores counts that begin anew.
    pub(super) ack_count: u32,
    pub(super) nack_frag_count: u32,
    pub(super) stats: ReaderStats,
}

impl Reader {
    /// A reader without writers. Memory is taken here and never again.
    #[must_use]
    pub fn new(guid: Guid, qos: Qos, limits: &ReaderLimits) -> Self {
        Reader {
            guid,
            qos,
            store: Store::new(limits.samples, limits.sample_bytes.max(4)),
            writers: Vec::with_capacity(limits.writers.max(1)),
            past: Vec::with_capacity(limits.writers.max(1)),
            most_writers: limits.writers.max(1),
            next_writer: 0,
            ack_count: 0,
            nack_frag_count: 0,
            stats: ReaderStats::default(),
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

    /// Matched writers.
    #[must_use]
    pub const fn matched(&self) -> usize {
        self.writers.len()
    }

    /// Its counts.
    #[must_use]
    pub const fn stats(&self) -> ReaderStats {
        self.stats
    }

    /// Samples that can be taken.
    #[must_use]
    pub fn ready(&self) -> usize {
        self.store.ready()
    }

    /// Matches a writer whose ACKNACKs go to `to`; `false` if there is no room for it. One that is
    /// known gets the new address.
    pub fn add_writer(&mut self, guid: Guid, qos: &Qos, to: SocketAddr) -> bool {
        if let Some(known) = self.writers.iter_mut().find(|writer| writer.guid == guid) {
            known.to = to;
            return true;
        }
        if self.writers.len() >= self.most_writers {
            return false;
        }
        let reliable = self.qos.reliability == Reliability::Reliable
            && qos.reliability == Reliability::Reliable;
        let latched = qos.durability >= Durability::TransientLocal;
        let late = latched && self.qos.durability >= Durability::TransientLocal;
        let mut qos = *qos;
        if guid.prefix == self.guid.prefix && qos.liveliness == LivelinessKind::Automatic {
            qos.liveliness_lease = INFINITE; // it lives as long as the reader
        }
        let mut writer = PeerWriter::new(guid, to, (reliable, late), &qos);
        writer.reveals = latched && !late && guid.prefix.0.starts_with(&CYCLONE);
        if let Some(at) = self.past.iter().position(|past| past.guid == guid) {
            let past = self.past.remove(at);
            // A best-effort writer repeats no sample.
            if reliable {
                writer.continues(&past);
            }
        }
        self.writers.push(writer);
        true
    }

    /// Takes a writer out; samples that are ready stay. `false` if it was not matched. The number
    /// of its last sample is kept for the case that it comes back.
    pub fn remove_writer(&mut self, guid: Guid) -> bool {
        if let Some(writer) = self.writers.iter().find(|writer| writer.guid == guid) {
            if self.past.len() >= self.most_writers {
                self.past.remove(0);
            }
            self.past.push(*writer);
        }
        self.forget_writer(guid)
    }

    /// Writers that are gone for good: those that come under their names are others.
    pub(crate) fn forget_past(&mut self, gone: impl Fn(Guid) -> bool) {
        self.past.retain(|past| !gone(past.guid));
    }

    fn forget_writer(&mut self, guid: Guid) -> bool {
        let before = self.writers.len();
        self.writers.retain(|writer| writer.guid != guid);
        for at in 0..self.store.slots.len() {
            let slot = self.store.slots.get(at);
            let waits = |slot: &Slot| !matches!(slot.state, State::Free | State::Ready);
            if slot.is_some_and(|slot| slot.writer == guid && waits(slot)) {
                self.store.release(at);
            }
        }
        before != self.writers.len()
    }

    /// Writers of the participant `prefix` are gone. If they come back, everything is read anew.
    pub(crate) fn remove_participant(&mut self, prefix: GuidPrefix) {
        let of = |writer: &&PeerWriter| writer.guid.prefix == prefix;
        while let Some(guid) = self.writers.iter().find(of).map(|writer| writer.guid) {
            self.forget_writer(guid);
        }
    }

    /// Everything of a participant's latched writers is read anew.
    pub(crate) fn begin_anew(&mut self, prefix: GuidPrefix) {
        let qos = self.qos;
        let mut writers = self.writers.iter();
        let of = |writer: &&PeerWriter| writer.guid.prefix == prefix;
        if let Some(PeerWriter { guid, to, .. }) = writers.find(of).copied() {
            self.forget_writer(guid);
            self.add_writer(guid, &qos, to);
        }
    }

    /// The matched writers.
    pub(crate) fn writers(&self) -> impl Iterator<Item = Guid> + '_ {
        self.writers.iter().map(|writer| writer.guid)
    }

    /// Takes the next sample. The sample has left the reader: its memory is used again by the next
    /// call that takes `&mut self`.
    pub fn take(&mut self) -> Option<Sample<'_>> {
        let at = self.store.take()?;
        let slot = self.store.slots.get(at)?;
        Some(sample(slot, self.store.bytes(at)))
    }

    /// Bytes of the sample that [`take`](Self::take) gives next, with its encapsulation.
    #[must_use]
    pub fn next_len(&self) -> Option<usize> {
        self.store.next_len()
    }

    /// Takes the next sample in its buffer, without a copy: `spare` becomes the reader's. `None`
    /// without a sample, or if `spare` is not exactly as long as the longest sample.
    pub fn take_into<'s>(&mut self, spare: &'s mut Box<[u8]>) -> Option<Sample<'s>> {
        if spare.len() != self.store.size() {
            return None;
        }
        let at = self.store.take()?;
        let slot = self.store.slots.get(at).copied()?;
        self.store.exchange(at, spare);
        Some(sample(&slot, spare.get(..slot.len).unwrap_or(&[])))
    }
}
