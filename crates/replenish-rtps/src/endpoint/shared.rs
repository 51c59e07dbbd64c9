//! Samples that a reader fetches from memory which their writer shares with programs on its host.
//!
//! ```text
//!   writer announces ──► reader wants it ──opened──► SHARED: taken ──► references instead of
//!   its memory                 │                        ▲              fragments
//!                              │ could not be           │ fragments came: it was lost
//!                              ▼                        │
//!                           refused ◄──fetch failed─── open
//! ```
//!
//! A reference counts as a sample in fragments of which none has come. A fetch that fails leaves it
//! so, and repair asks for the fragments: nothing depends on whether shared memory works.

use super::offer::Offer;
use super::peer_writer::PeerWriter;
use super::reader::Reader;
use super::store::{Slot, State};
use super::writer::Writer;
use crate::wire::{
    Durability, EntityId, Guid, GuidPrefix, INFINITE, MessageWriter, Nanos, Reference, SegmentName,
    SequenceNumber, Shared, SharedPlace, Timestamp, WireError, chain_origins, related_request,
};
use alloc::boxed::Box;

/// Says to a reader where a sample is: `(number, bytes, bytes of a fragment)`.
pub(super) fn refer(
    m: &mut MessageWriter<'_>,
    (writer, reader): (EntityId, EntityId),
    (sn, len, fragment): (SequenceNumber, usize, usize),
    place: SharedPlace,
    inline_qos: &[u8],
) -> Result<(), WireError> {
    let body = Reference {
        reader,
        writer,
        sn,
        sample_size: u32::try_from(len).unwrap_or(u32::MAX),
        place,
        fragment_size: u16::try_from(fragment).unwrap_or(u16::MAX),
        inline_qos: None,
    };
    m.reference(&body, inline_qos)
}

impl PeerWriter {
    /// The time at which the writer gets an answer at the latest.
    pub(super) fn answers_at(&self) -> Nanos {
        match (self.offer, self.ack) {
            (Some(Offer { say: true, .. }), _) => 0,
            (_, true) => self.ack_at,
            _ => INFINITE,
        }
    }

    /// Whether the writer is to hear that references are taken or not.
    pub(super) fn say(&mut self) -> Option<bool> {
        let offer = self.offer.as_mut().filter(|offer| offer.say)?;
        offer.say = false;
        offer.open
    }

    fn is_open(&self) -> bool {
        self.offer.is_some_and(|offer| offer.open == Some(true))
    }
}

/// A sample to be fetched, with the buffer for its bytes.
#[derive(Debug)]
pub struct Fetch {
    /// The reader.
    pub reader: Guid,
    /// The writer in whose memory the sample is.
    pub writer: Guid,
    /// The place in that memory.
    pub place: SharedPlace,
    at: usize,
    sn: SequenceNumber,
    len: usize,
    buffer: Box<[u8]>,
}

impl Fetch {
    /// The room for the sample's bytes, all of which are to be written.
    pub fn room(&mut self) -> &mut [u8] {
        self.buffer.get_mut(..self.len).unwrap_or_default()
    }
}

impl Reader {
    /// A matched writer shares its memory under this name, or does not.
    pub fn offer(&mut self, writer: Guid, name: Option<SegmentName>) {
        let known = self.find(writer).and_then(|at| self.writers.get_mut(at));
        if let Some(known) = known
            && known.offer.map(|offer| offer.name) != name
        {
            known.offer = name.map(|name| Offer {
                name,
                open: None,
                say: false,
            });
        }
    }

    /// Memory of a matched writer which nobody has tried to open yet.
    #[must_use]
    pub fn wanted_segment(&self) -> Option<(Guid, SegmentName)> {
        let untried = |writer: &PeerWriter| {
            let offer = writer.offer.filter(|offer| offer.open.is_none())?;
            Some((writer.guid, offer.name))
        };
        self.writers.iter().find_map(untried)
    }

    /// The memory of a writer was opened, or could not be.
    pub fn segment_opened(&mut self, writer: Guid, open: bool) {
        let known = self.find(writer).and_then(|at| self.writers.get_mut(at));
        if let Some(offer) = known.and_then(|known| known.offer.as_mut()) {
            // A writer that has not heard that references are taken sends none.
            offer.say = open || offer.open == Some(true);
            offer.open = Some(open);
        }
    }

    /// A sample comes in fragments: its writer may not know that references are taken.
    pub(super) fn asks_for_references(&mut self, at: usize) {
        if let Some(writer) = self.writers.get_mut(at)
            && writer.is_open()
            && let Some(offer) = &mut writer.offer
        {
            offer.say = true;
        }
    }

    /// A sample of the participant `from` that is in its writer's memory.
    pub fn reference(&mut self, from: GuidPrefix, body: &Reference<'_>, source: Option<Timestamp>) {
        let guid = Guid::new(from, body.writer);
        let Some(at) = self.find(guid) else {
            return;
        };
        let total = body
            .sample_size
            .div_ceil(u32::from(body.fragment_size.max(1)));
        let len = match usize::try_from(body.sample_size) {
            Ok(len) if total <= self.store.most_fragments() => len,
            _ => usize::MAX,
        };
        let Some(place) = self.admit(at, body.sn, len) else {
            return;
        };
        let open = self.writers.get(at).is_some_and(PeerWriter::is_open);
        let slot = Slot {
            state: if open {
                State::Referred
            } else {
                State::Partial
            },
            writer: guid,
            sn: body.sn,
            len,
            source,
            gone: None,
            related: related_request(body.inline_qos),
            origins: chain_origins(body.inline_qos),
            lifespan: self.lifespan(at),
            fragment_size: body.fragment_size,
            missing: total,
            passed: None,
            shared: Some(body.place),
        };
        self.store.begin(place, slot);
        let writer = self.writers.get_mut(at);
        if let Some(offer) = writer.and_then(|writer| writer.offer.as_mut()) {
            // The writer may not have heard it.
            offer.say |= offer.open == Some(false);
        }
    }

    /// Takes a sample that is to be fetched, to be given back with [`fetched`](Self::fetched).
    pub fn fetch(&mut self) -> Option<Fetch> {
        let (at, slot, buffer) = self.store.lend()?;
        Some(Fetch {
            reader: self.guid,
            writer: slot.writer,
            place: slot.shared?,
            at,
            sn: slot.sn,
            len: slot.len,
            buffer,
        })
    }

    /// Gives a sample back: whether its room has all bytes of it. If not, it is asked for in
    /// fragments. `broken`: so are later ones, since its writer's memory cannot be read.
    pub fn fetched(&mut self, fetch: Fetch, whole: bool, broken: bool) {
        let Fetch { writer, at, sn, .. } = fetch;
        self.store.give_back(at, fetch.buffer);
        let peer = self.find(writer);
        let known = peer.and_then(|peer| self.writers.get(peer));
        let new = known.is_some_and(|known| !known.has(sn));
        let Some(slot) = self.store.slots.get_mut(at) else {
            return;
        };
        // It may have been given up meanwhile, and its writer may be gone.
        let wanted = (slot.writer, slot.sn) == (writer, sn);
        slot.state = State::Free;
        if broken {
            self.segment_opened(writer, false);
        }
        let Some(peer) = peer.filter(|_| new && wanted) else {
            return;
        };
        if whole {
            self.complete(peer, at, sn);
        } else if let Some(slot) = self.store.slots.get_mut(at) {
            slot.state = State::Partial;
        }
    }
}

impl Writer {
    /// Whether a sample with a place in shared memory would be fetched from there, by a reader that
    /// is matched or by one that comes late.
    #[must_use]
    pub fn is_fetched(&self) -> bool {
        let late = self.qos().durability >= Durability::TransientLocal;
        late || self.readers.iter().any(|reader| reader.fetches)
    }

    /// A reader of `from` says whether it takes references.
    pub fn shared(&mut self, from: GuidPrefix, body: &Shared) {
        let guid = Guid::new(from, body.reader);
        let mut readers = self.readers.iter_mut();
        if let Some(reader) = readers.find(|reader| reader.guid == guid) {
            reader.fetches = body.taken;
        }
    }
}
