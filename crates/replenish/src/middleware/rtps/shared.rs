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

use super::qos::LONG;
use crate::platform::zeroed;
use crate::sync::Arc;
use alloc::boxed::Box;
use alloc::vec::Vec;
use core::hash::BuildHasher;
use replenish_os::{SegmentReader, SegmentWriter, clock};
use replenish_rtps::wire::{Guid, SegmentName, SharedPlace};
use std::hash::RandomState;

/// Bytes of the memory of one publisher at most, unless three samples are longer.
const MOST: usize = 64 << 20;
/// Slots besides those of the samples that are kept: one is being written, one still read.
const MORE: usize = 2;
const LEAST: usize = 3;
/// Publishers whose memory is open at a time; others send fragments.
pub(super) const OPEN: usize = 64;

/// Room that a publisher fills without the lock.
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
        // A forked child has its parent's keys of `RandomState`.
        let own = (std::process::id(), clock::monotonic());
        let cookie = || RandomState::new().hash_one((own, bytes));
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
    pub(super) open: Vec<(Guid, Arc<SegmentReader>)>,
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

    pub(super) fn of(&self, writer: Guid) -> Option<&Arc<SegmentReader>> {
        let mut open = self.open.iter();
        open.find(|(of, _)| *of == writer).map(|(_, memory)| memory)
    }
}
