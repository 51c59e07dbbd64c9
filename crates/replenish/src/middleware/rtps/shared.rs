//! Long samples between programs on one host: through memory of the publisher, by reference.
//!
//! ```text
//!   publisher's thread                               dispatcher, or the subscription's worker
//!   sample ─► buffer ─► slot of the memory           reference comes
//!   lock ─ write ─ unlock                            lock ─ take a place and its buffer ─ unlock
//!   lock ─ send a reference ─ unlock                 copy out of the slot, look at its stamp
//!                                                    lock ─ the sample is there, or lost ─ unlock
//! ```
//!
//! The history keeps every sample besides: other readers, and those that cannot open the memory,
//! get fragments of it. Nothing of the protocol depends on the memory, see `replenish_rtps`.

use super::adapter::Rtps;
use super::qos::LONG;
use super::state::State;
use crate::platform::zeroed;
use crate::sync::Arc;
use alloc::boxed::Box;
use alloc::vec::Vec;
use core::hash::BuildHasher;
use replenish_os::{Fetched, PiMutex, PiMutexGuard, SegmentReader, SegmentWriter, clock};
use replenish_rtps::participant as rtps;
use replenish_rtps::wire::{Guid, SegmentName, SharedPlace};
use std::hash::RandomState;

/// Bytes of the memory of one publisher at most, unless three samples are longer.
const MOST: usize = 64 << 20;
/// Slots besides those of the samples that are kept: one is being written, one still read.
const MORE: usize = 2;
const LEAST: usize = 3;
/// Publishers whose memory is open at a time; others send fragments.
const OPEN: usize = 64;

/// What a publisher has to fill without the lock.
pub(super) struct Spare {
    /// A buffer that is exchanged for one of the history.
    pub(super) buffer: Box<[u8]>,
    memory: Option<SegmentWriter>,
}

impl Spare {
    /// A buffer for samples of `bytes`, and if they are long, memory for the last `depth` of them,
    /// if it is to be shared and can be had.
    pub(super) fn new(bytes: usize, depth: usize, is_shared: bool) -> Self {
        let slots = MOST.checked_div(bytes).unwrap_or(LEAST).max(LEAST);
        let slots = depth.saturating_add(MORE).min(slots).max(LEAST);
        let cookie = || RandomState::new().hash_one(bytes);
        let memory =
            (is_shared && bytes >= LONG).then(|| SegmentWriter::new(slots, bytes, cookie()));
        Self {
            buffer: zeroed(bytes),
            memory: memory.and_then(Result::ok),
        }
    }

    /// The name of the memory, for those who can open it.
    pub(super) fn segment(&self) -> Option<SegmentName> {
        let memory = self.memory.as_ref()?;
        Some(SegmentName(memory.name()))
    }

    /// Copies a long sample, the first `len` bytes of the buffer, into the memory if anybody
    /// fetches it there: its place.
    pub(super) fn share(&mut self, len: usize, is_fetched: bool) -> Option<SharedPlace> {
        let memory = self.memory.as_mut().filter(|_| is_fetched && len >= LONG)?;
        let (slot, stamp) = memory.put(self.buffer.get(..len)?)?;
        Some(SharedPlace { slot, stamp })
    }
}

/// The memory of other publishers.
pub(super) struct Segments {
    pub(super) is_used: bool,
    /// Endpoints were matched or parted.
    pub(super) has_changed: bool,
    open: Vec<(Guid, Arc<SegmentReader>)>,
}

impl Segments {
    pub(super) fn new(is_used: bool) -> Self {
        let most = if is_used { OPEN } else { 0 };
        Self {
            is_used,
            has_changed: false,
            open: Vec::with_capacity(most),
        }
    }

    fn of(&self, writer: Guid) -> Option<&Arc<SegmentReader>> {
        let mut open = self.open.iter();
        open.find(|(of, _)| *of == writer).map(|(_, memory)| memory)
    }
}

impl Rtps {
    /// Opens the memory of publishers that were matched, and closes that of those that have gone.
    ///
    /// Discovery alone comes here: opening maps the memory and allocates.
    #[cold]
    pub(super) fn look_after_segments(&self) {
        loop {
            let mut state = self.state.lock();
            let State {
                segments,
                participant,
                ..
            } = &mut *state;
            segments.has_changed = false;
            let mut open = segments.open.iter();
            let parted = open.position(|(writer, _)| !participant.has_reader_of(*writer));
            if let Some(at) = parted {
                let closed = segments.open.swap_remove(at);
                drop(state);
                drop(closed); // unmapped without the lock
                continue;
            }
            let Some((writer, name)) = participant.wanted_segment() else {
                return;
            };
            let is_open = segments.of(writer).is_some();
            let has_room = segments.open.len() < OPEN;
            drop(state);
            let opened = (!is_open && has_room).then(|| SegmentReader::open(name.0));
            let opened = opened.and_then(Result::ok);
            let mut state = self.state.lock();
            let is_open = is_open || opened.is_some();
            if let Some(memory) = opened {
                state.segments.open.push((writer, Arc::new(memory)));
            }
            state.participant.segment_opened(writer, is_open);
        }
    }
}

impl State {
    /// Copies samples to which references have come, each without the lock: those of `only`, or of
    /// all readers.
    pub(super) fn fetch_all<'m>(
        lock: &'m PiMutex<Self>,
        mut state: PiMutexGuard<'m, Self>,
        only: Option<rtps::ReaderId>,
    ) -> PiMutexGuard<'m, Self> {
        while let Some(mut fetch) = state.participant.fetch(only) {
            let memory = state.segments.of(fetch.writer).map(Arc::clone);
            drop(state);
            let SharedPlace { slot, stamp } = fetch.place;
            let read = |memory: Arc<SegmentReader>| memory.read(slot, stamp, fetch.room());
            let fetched = memory.map_or(Fetched::Broken, read);
            let now = clock::monotonic();
            state = lock.lock();
            let whole = fetched == Fetched::Whole;
            state.stats.shared += u64::from(whole);
            let broken = fetched == Fetched::Broken;
            state.participant.fetched(fetch, whole, broken, now);
        }
        state
    }
}
