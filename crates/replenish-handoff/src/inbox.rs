//! The inbox of one subscription: filled by the dispatcher, emptied by one worker.
//!
//! ```text
//!              deliver, last slot taken (keep-all)
//!   listening ────────────────────────────────────► parked     (out of the interest set)
//!       ▲                                              │
//!       └──────────────────────────────────────────────┘ pop, clear, close: wake the middleware
//!
//!   close (a callback panicked): from then on samples are accepted and discarded
//! ```
//!
//! Buffers change hands, one for another: the dispatcher keeps an empty one to fill, the worker
//! the one that it has read last. So either side takes the lock once per sample.
//!
//! *Parked* is decided under the same lock that gives the last slot away, and left under the same
//! lock that frees one. The thread that ends it wakes the middleware, whose wake-up is sticky. So
//! the dispatcher either sees the room before it waits, or its wait ends at once.

use super::ring::{Ring, RingSlot};
use super::{SampleInfo, Shared};
use crate::sync::{AtomicUsize, Mutex, Ordering};

/// Bounded, preallocated queue of one subscription.
pub struct Inbox {
    state: Mutex<State>,
    /// The number of samples that wait; written under the lock, so that a look costs none.
    waiting: AtomicUsize,
    keep: Keep,
}

/// The samples that survive when more arrive than there are slots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keep {
    /// The oldest makes room.
    Newest,
    /// The new one is dropped.
    Oldest,
    /// None is dropped: the reader leaves the interest set until there is room.
    All,
}

struct State {
    ring: Ring,
    parked: bool,
    closed: bool,
}

/// The fate of a delivered sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeliveryOutcome {
    /// It waits for the worker.
    Stored,
    /// It waits for the worker; the oldest one made room.
    ReplacedOldest,
    /// It is larger than a slot.
    Oversize,
    /// There was no room although the middleware had been told so.
    NoRoom,
    /// The handle has stopped.
    Closed,
}

/// The answer to a delivered sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Delivery {
    /// Whether the sample is stored, and if not, why not.
    pub outcome: DeliveryOutcome,
    /// Whether the reader has just left the interest set.
    pub parked: bool,
}

impl Inbox {
    /// An inbox for `depth` samples of up to `size` bytes; allocates everything it will ever need.
    pub fn new(depth: usize, size: usize, keep: Keep) -> Self {
        Self {
            state: Mutex::new(State {
                ring: Ring::new(depth, size),
                parked: false,
                closed: false,
            }),
            waiting: AtomicUsize::new(0),
            keep,
        }
    }

    /// Dispatcher: stores a sample.
    ///
    /// The bytes are copied outside the lock, into the buffer in `spare_slot`, which gets an
    /// empty one in exchange. Each call passes the same `spare_slot`, `None` at first.
    pub fn deliver(
        &self,
        spare_slot: &mut Option<RingSlot>,
        bytes: &[u8],
        info: &SampleInfo,
    ) -> Delivery {
        let refused = |outcome, parked| Delivery { outcome, parked };
        if spare_slot.is_none() {
            *spare_slot = self.state.lock().ring.spare();
        }
        let Some(mut slot) = spare_slot.take() else {
            return refused(DeliveryOutcome::NoRoom, false);
        };
        let fits = slot.fill(bytes, info);
        let state = &mut *self.state.lock();
        let no_room = self.keep != Keep::Newest && state.ring.is_full();
        if state.closed || no_room || !fits {
            *spare_slot = Some(slot);
            if state.closed {
                return refused(DeliveryOutcome::Closed, false);
            }
            if !no_room {
                return refused(DeliveryOutcome::Oversize, false);
            }
            state.parked = self.keep == Keep::All;
            return refused(DeliveryOutcome::NoRoom, state.parked);
        }
        let replaced = state.ring.push(slot);
        let outcome = match replaced {
            Some(_) => DeliveryOutcome::ReplacedOldest,
            None => DeliveryOutcome::Stored,
        };
        *spare_slot = replaced.or_else(|| state.ring.spare());
        self.show(state);
        state.parked = self.keep == Keep::All && state.ring.is_full();
        let parked = state.parked;
        Delivery { outcome, parked }
    }

    /// Publisher: stores a sample that is in memory. Any thread; nothing is copied, and the lock is
    /// held while one buffer changes hands.
    ///
    /// Not for an inbox that [keeps all](Keep::All): the dispatcher, which does not see this, would
    /// find no room for a sample that its middleware has given away.
    pub fn share(&self, message: &Shared, info: &SampleInfo) -> DeliveryOutcome {
        let state = &mut *self.state.lock();
        if state.closed {
            return DeliveryOutcome::Closed;
        }
        let full = state.ring.is_full();
        if full && self.keep != Keep::Newest {
            return DeliveryOutcome::NoRoom;
        }
        let slot = if full {
            state.ring.pop()
        } else {
            state.ring.spare()
        };
        let Some(mut slot) = slot else {
            return DeliveryOutcome::NoRoom;
        };
        slot.hold(message, info);
        state.ring.push(slot);
        self.show(state);
        if full {
            DeliveryOutcome::ReplacedOldest
        } else {
            DeliveryOutcome::Stored
        }
    }

    /// The rule by which samples survive.
    pub const fn keep(&self) -> Keep {
        self.keep
    }

    /// Dispatcher: whether the reader stays out of the interest set.
    pub fn is_parked(&self) -> bool {
        self.state.lock().parked
    }

    /// Worker: the oldest sample, if there is one, in exchange for the one that it has read.
    ///
    /// Frees the sample's place in the queue, so that the next one can come while this one is
    /// worked on. Returns whether the middleware must be woken, since the reader has rejoined the
    /// interest set.
    pub fn pop(&self, read_slot: &mut Option<RingSlot>) -> Option<bool> {
        if self.waiting() == 0 {
            return None;
        }
        let state = &mut *self.state.lock();
        let next = state.ring.pop()?;
        if let Some(read) = read_slot.replace(next) {
            state.ring.give_back(read);
        }
        self.show(state);
        Some(core::mem::take(&mut state.parked))
    }

    /// When the oldest sample that waits arrived, in ns.
    pub fn oldest(&self) -> Option<u64> {
        if self.waiting() == 0 {
            return None;
        }
        let state = self.state.lock();
        state.ring.waiting().next().map(|s| s.info().arrival)
    }

    /// Bytes of the memory for its samples.
    pub fn memory(&self) -> usize {
        self.state.lock().ring.memory()
    }

    /// The number of samples that wait.
    pub fn waiting(&self) -> usize {
        self.waiting.load(Ordering::Acquire)
    }

    /// Whether everything that comes is discarded.
    pub fn is_closed(&self) -> bool {
        self.state.lock().closed
    }

    fn show(&self, state: &State) {
        self.waiting.store(state.ring.len(), Ordering::Release);
    }

    /// Discards what waits. Returns how many samples, and whether the middleware must be woken.
    pub fn clear(&self) -> (usize, bool) {
        let mut state = self.state.lock();
        let discarded = state.ring.clear();
        self.show(&state);
        (discarded, core::mem::take(&mut state.parked))
    }

    /// Discards what waits and everything that will come. Answers as [`Inbox::clear`].
    pub fn close(&self) -> (usize, bool) {
        self.state.lock().closed = true;
        self.clear()
    }
}
