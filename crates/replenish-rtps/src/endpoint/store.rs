//! [`Store`]: the samples of a reader, whole and in parts, in memory taken at set-up.

use crate::wire::{
    Bits, ChainOrigins, FragmentSet, Guid, Nanos, SampleIdentity, SequenceNumber, SharedPlace,
    Timestamp,
};
use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec;

/// The smallest fragments of which a longest sample may consist.
const LEAST_FRAGMENT: usize = 512;

/// The life of a slot.
///
/// ```text
///   free ──► partial ─────────► held ──► ready ──► free
///     │         ▲                ▲ ▲       ▲
///     ├─────────┼────────────────┼─┴───────┤
///     │         │ failed         │ whole   │
///     └──► referred ──► fetched ─┴─────────┘
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) enum State {
    #[default]
    Free,
    /// Fragments are missing.
    Partial,
    /// Whole, but an earlier sample of its writer is missing.
    Held,
    /// To be fetched from its writer's memory.
    Referred,
    /// Being fetched: its buffer is elsewhere.
    Fetched,
    /// To be read, in the order of the queue.
    Ready,
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Slot {
    pub(crate) state: State,
    pub(crate) writer: Guid,
    pub(crate) sn: SequenceNumber,
    pub(crate) len: usize,
    pub(crate) source: Option<Timestamp>,
    /// The bytes are the key of an instance that is gone; if none, its name.
    pub(crate) gone: Option<Guid>,
    /// The request that it belongs to.
    pub(crate) related: Option<SampleIdentity>,
    /// The chains that led to it.
    pub(crate) origins: ChainOrigins,
    /// Time in ns for which it is of use.
    pub(crate) lifespan: Nanos,
    pub(crate) fragment_size: u16,
    /// Fragments that are missing.
    pub(crate) missing: u32,
    /// The first sample of another best-effort writer that was refused since a fragment came.
    pub(crate) passed: Option<(Guid, SequenceNumber)>,
    /// The place in its writer's memory.
    pub(crate) shared: Option<SharedPlace>,
}

#[derive(Debug)]
pub(crate) struct Store {
    pub(crate) slots: Box<[Slot]>,
    /// A buffer for each slot.
    bytes: Box<[Box<[u8]>]>,
    arrived: Box<[u32]>,
    words: usize,
    size: usize,
    ready: VecDeque<usize>,
}

impl Store {
    pub(crate) fn new(samples: usize, size: usize) -> Self {
        let samples = samples.max(1);
        let words = size.div_ceil(LEAST_FRAGMENT).div_ceil(32).max(1);
        Store {
            slots: vec![Slot::default(); samples].into_boxed_slice(),
            bytes: (0..samples).map(|_| vec![0; size].into()).collect(),
            arrived: vec![0; samples.saturating_mul(words)].into_boxed_slice(),
            words,
            size,
            ready: VecDeque::with_capacity(samples),
        }
    }

    pub(crate) const fn size(&self) -> usize {
        self.size
    }

    pub(crate) fn most_fragments(&self) -> u32 {
        u32::try_from(self.words.saturating_mul(32)).unwrap_or(u32::MAX)
    }

    pub(crate) fn ready(&self) -> usize {
        self.ready.len()
    }

    pub(crate) fn find(&self, writer: Guid, sn: SequenceNumber) -> Option<usize> {
        let same = |slot: &Slot| slot.sn == sn && slot.writer == writer;
        let busy = |slot: &Slot| !matches!(slot.state, State::Free | State::Ready);
        self.slots.iter().position(|slot| busy(slot) && same(slot))
    }

    pub(crate) fn free(&self) -> Option<usize> {
        let free = |slot: &Slot| slot.state == State::Free;
        self.slots.iter().position(free)
    }

    /// Takes a free slot for a sample of `len` bytes, none of which is there yet.
    pub(crate) fn begin(&mut self, at: usize, slot: Slot) {
        for word in self.arrived_mut(at).iter_mut() {
            *word = 0;
        }
        if let Some(place) = self.slots.get_mut(at) {
            *place = slot;
        }
    }

    /// The slot is free; one that is being fetched is as soon as its buffer is back.
    pub(crate) fn release(&mut self, at: usize) {
        match self.slots.get_mut(at) {
            Some(slot) if slot.state == State::Fetched => slot.sn = 0,
            Some(slot) => slot.state = State::Free,
            None => {}
        }
    }

    /// Whether fragments of the sample have been asked for, or can be.
    pub(crate) fn is_partial(&self, at: usize) -> bool {
        let slot = self.slots.get(at);
        slot.is_some_and(|slot| slot.state == State::Partial)
    }

    /// Takes the buffer out of a slot that is to be fetched.
    pub(crate) fn lend(&mut self) -> Option<(usize, Slot, Box<[u8]>)> {
        let referred = |slot: &Slot| slot.state == State::Referred;
        let at = self.slots.iter().position(referred)?;
        let slot = self.slots.get_mut(at)?;
        let buffer = core::mem::take(self.bytes.get_mut(at)?);
        slot.state = State::Fetched;
        Some((at, *slot, buffer))
    }

    /// Takes the buffer back.
    pub(crate) fn give_back(&mut self, at: usize, buffer: Box<[u8]>) {
        if let Some(room) = self.bytes.get_mut(at) {
            *room = buffer;
        }
    }

    /// Puts `bytes` at `from`; both are inside of the slot's length.
    pub(crate) fn put(&mut self, at: usize, from: usize, bytes: &[u8]) {
        let end = from.saturating_add(bytes.len());
        let buffer = self.bytes.get_mut(at);
        if let Some(room) = buffer.and_then(|buffer| buffer.get_mut(from..end)) {
            replenish_wire::copy(room, bytes);
        }
    }

    pub(crate) fn bytes(&self, at: usize) -> &[u8] {
        let len = self.slots.get(at).map_or(0, |slot| slot.len);
        let buffer = self.bytes.get(at);
        buffer.and_then(|buffer| buffer.get(..len)).unwrap_or(&[])
    }

    /// Exchanges the buffer of a slot for one of the same length; `false` if it has another one.
    pub(crate) fn exchange(&mut self, at: usize, buffer: &mut Box<[u8]>) -> bool {
        let own = self.bytes.get_mut(at);
        let own = own.filter(|own| own.len() == buffer.len());
        own.is_some_and(|own| {
            core::mem::swap(own, buffer);
            true
        })
    }

    /// Bytes of the sample that [`take`](Self::take) gives next.
    pub(crate) fn next_len(&self) -> Option<usize> {
        let at = *self.ready.front()?;
        self.slots.get(at).map(|slot| slot.len)
    }

    fn arrived_mut(&mut self, at: usize) -> &mut [u32] {
        let start = at.saturating_mul(self.words);
        let words = self
            .arrived
            .get_mut(start..start.saturating_add(self.words));
        words.unwrap_or_default()
    }

    /// Marks fragment `number`, from 1; `false` if it was there.
    pub(crate) fn arrive(&mut self, at: usize, number: u32) -> bool {
        let index = number.saturating_sub(1);
        let word = self.arrived_mut(at).get_mut((index / 32) as usize);
        let Some(word) = word else {
            return false;
        };
        let bit = 1 << (index % 32);
        let new = *word & bit == 0;
        *word |= bit;
        if let Some(slot) = self.slots.get_mut(at).filter(|_| new) {
            slot.missing = slot.missing.saturating_sub(1);
            slot.passed = None;
        }
        new
    }

    /// The missing fragments: the first `most` of 256 from the first one on.
    pub(crate) fn missing(&self, at: usize, most: u32) -> Option<FragmentSet> {
        let slot = self.slots.get(at)?;
        let size = usize::from(slot.fragment_size.max(1));
        let total = u32::try_from(slot.len.div_ceil(size)).ok()?;
        let start = at.saturating_mul(self.words);
        let words = self.arrived.get(start..start.saturating_add(self.words))?;
        let lacks = |number: &u32| {
            let index = number.saturating_sub(1);
            let word = words.get((index / 32) as usize);
            word.is_some_and(|word| word & (1 << (index % 32)) == 0)
        };
        let first = (1..=total).find(lacks)?;
        let mut set = FragmentSet::empty(first);
        let end = first.saturating_add(Bits::MAX).min(total.saturating_add(1));
        for number in (first..end).filter(lacks).take(most as usize) {
            set.insert(number);
        }
        Some(set)
    }

    /// The slot is to be read after those that are ready.
    pub(crate) fn make_ready(&mut self, at: usize) {
        if let Some(slot) = self.slots.get_mut(at) {
            slot.state = State::Ready;
            self.ready.push_back(at);
        }
    }

    /// Takes the sample that was ready first. Its bytes stay until the slot is used again.
    pub(crate) fn take(&mut self) -> Option<usize> {
        let at = self.ready.pop_front()?;
        self.release(at);
        Some(at)
    }
}
