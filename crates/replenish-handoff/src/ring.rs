//! A bounded queue of preallocated buffers. Plain data: its owner brings the lock.
//!
//! ```text
//!             spare()                push()                  pop()
//!   free ────────────► (being filled) ──────► waiting ────────────► (being read)
//!    ▲                                     │ depth reached: the oldest  │
//!    └─────────────────────────────────────┴────────────────────────────┘ give_back()
//! ```
//!
//! A buffer can [hold](RingSlot::hold) a sample that is in memory instead of its bytes.
//!
//! A ring of depth `d` owns `d + 2` buffers: `d` that wait, one in the hands of the one that fills
//! and one in the hands of the one that reads. Buffers move by value (one word), so bytes are
//! copied outside the lock, and a spare one is always there for a single filler.

use super::{SampleInfo, Shared};
use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::ops::Deref;

/// One preallocated buffer with the sample in it.
#[derive(Debug)]
pub struct RingSlot(Box<Filled>);

/// Together, since a thread that looks at one looks at the others.
#[derive(Debug)]
struct Filled {
    bytes: Box<[u8]>,
    len: usize,
    info: Note,
    /// The sample as it is in memory, instead of bytes.
    shared: Option<Shared>,
}

/// The information about a sample, as it is kept.
#[cfg(feature = "sample-info")]
#[derive(Debug)]
struct Note(SampleInfo);

#[cfg(feature = "sample-info")]
impl Note {
    const fn of(info: &SampleInfo) -> Self {
        Self(*info)
    }

    const fn get(&self) -> &SampleInfo {
        &self.0
    }
}

/// Where there are no services and nobody stamps samples, when one arrived is all that is known.
#[cfg(not(feature = "sample-info"))]
#[derive(Debug)]
struct Note(u64);

#[cfg(not(feature = "sample-info"))]
impl Note {
    const fn of(info: &SampleInfo) -> Self {
        Self(info.arrival)
    }

    const fn get(&self) -> Told {
        Told(SampleInfo::at(self.0))
    }
}

/// The information about a sample, made up from the little that was kept.
#[cfg(not(feature = "sample-info"))]
struct Told(SampleInfo);

#[cfg(not(feature = "sample-info"))]
impl Deref for Told {
    type Target = SampleInfo;

    fn deref(&self) -> &SampleInfo {
        &self.0
    }
}

impl RingSlot {
    fn new(size: usize) -> Self {
        Self(Box::new(Filled {
            bytes: alloc::vec![0; size].into_boxed_slice(),
            len: 0,
            info: Note::of(&SampleInfo::at(0)),
            shared: None,
        }))
    }

    /// Copies a sample into the buffer; `false`, and an empty slot, if it does not fit.
    pub fn fill(&mut self, bytes: &[u8], info: &SampleInfo) -> bool {
        let filled = &mut *self.0;
        filled.info = Note::of(info);
        filled.len = 0;
        filled.shared = None;
        let Some(room) = filled.bytes.get_mut(..bytes.len()) else {
            return false;
        };
        replenish_wire::copy(room, bytes);
        filled.len = bytes.len();
        true
    }

    /// Holds a sample that is in memory; the buffer stays as it is.
    pub fn hold(&mut self, message: &Shared, info: &SampleInfo) {
        let filled = &mut *self.0;
        filled.info = Note::of(info);
        filled.len = 0;
        filled.shared = Some(message).cloned();
    }

    /// The sample, if it is one in memory.
    pub fn shared(&self) -> Option<&Shared> {
        self.0.shared.as_ref()
    }

    /// Lets go of a sample in memory.
    pub fn take_shared(&mut self) -> Option<Shared> {
        self.0.shared.take()
    }

    /// The sample's bytes; none of one in memory.
    pub fn payload(&self) -> &[u8] {
        self.0.bytes.get(..self.0.len).unwrap_or_default()
    }

    /// The sample's information: when it came, and from whom.
    pub fn info(&self) -> impl Deref<Target = SampleInfo> + '_ {
        self.0.info.get()
    }
}

/// A bounded first-in first-out queue of [`RingSlot`]s. Allocates in [`Ring::new`] only.
#[derive(Debug)]
pub struct Ring {
    waiting: VecDeque<RingSlot>,
    free: Vec<RingSlot>,
    depth: usize,
}

impl Ring {
    /// A ring that lets `depth` samples of up to `size` bytes wait.
    pub fn new(depth: usize, size: usize) -> Self {
        let buffers = depth + 2;
        let mut ring = Self {
            waiting: VecDeque::with_capacity(buffers),
            free: Vec::with_capacity(buffers),
            depth,
        };
        (0..buffers).for_each(|_| ring.give_back(RingSlot::new(size)));
        ring
    }

    /// Bytes of all its buffers.
    pub fn memory(&self) -> usize {
        let size = |slot: &RingSlot| slot.0.bytes.len();
        let each = self.free.first().or(self.waiting.front()).map_or(0, size);
        each.saturating_mul(self.depth + 2)
    }

    /// A buffer to fill; `None` only while another filler or reader holds too many.
    pub fn spare(&mut self) -> Option<RingSlot> {
        self.free.pop()
    }

    /// Appends a filled buffer. With `depth` samples waiting, the oldest makes room, and is given
    /// back.
    pub fn push(&mut self, slot: RingSlot) -> Option<RingSlot> {
        let oldest = self.is_full().then(|| self.waiting.pop_front());
        // Always true, and the compiler leaves out the code that would grow the queue.
        if self.waiting.len() < self.waiting.capacity() {
            self.waiting.push_back(slot);
        }
        let mut oldest = oldest.flatten();
        if let Some(oldest) = &mut oldest {
            oldest.take_shared();
        }
        oldest
    }

    /// The oldest sample.
    pub fn pop(&mut self) -> Option<RingSlot> {
        self.waiting.pop_front()
    }

    /// The waiting samples, oldest first.
    pub fn waiting(&self) -> impl Iterator<Item = &RingSlot> {
        self.waiting.iter()
    }

    /// Returns a buffer that came from [`Ring::pop`] or [`Ring::spare`].
    pub fn give_back(&mut self, mut slot: RingSlot) {
        slot.take_shared();
        // Always true for a buffer of this ring: see `push`.
        if self.free.len() < self.free.capacity() {
            self.free.push(slot);
        }
    }

    /// Discards what waits and returns how many samples that were.
    pub fn clear(&mut self) -> usize {
        let waiting = self.waiting.len();
        let waiting_slots = self.waiting.drain(..).map(|mut slot| {
            slot.take_shared();
            slot
        });
        self.free.extend(waiting_slots);
        waiting
    }

    /// Whether `depth` samples wait.
    pub fn is_full(&self) -> bool {
        self.waiting.len() >= self.depth
    }

    /// The number of samples that wait.
    #[expect(clippy::len_without_is_empty, reason = "nobody asks")]
    pub fn len(&self) -> usize {
        self.waiting.len()
    }
}
