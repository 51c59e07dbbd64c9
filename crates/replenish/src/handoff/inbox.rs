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
//! *Parked* is decided under the same lock that gives the last slot away, and left under the same
//! lock that frees one; whoever ends it wakes the middleware, whose wake-up is sticky. So the
//! dispatcher either sees the room before it waits, or its wait ends at once.

use super::SampleInfo;
use super::ring::{Ring, Slot};
use crate::sync::{AtomicUsize, Mutex, Ordering};

/// Bounded, preallocated queue of one subscription.
pub(crate) struct Inbox {
    state: Mutex<State>,
    /// How many samples wait; written under the lock, so that a look costs none.
    waiting: AtomicUsize,
    keep: Keep,
}

/// Which samples survive when more arrive than there are slots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Keep {
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

/// What became of a delivered sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
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
pub(crate) struct Delivery {
    pub(crate) outcome: Outcome,
    /// Whether the reader has just left the interest set.
    pub(crate) parked: bool,
}

/// A sample for the worker.
#[derive(Debug)]
pub(crate) struct Popped {
    /// To be returned through [`Inbox::give_back`].
    pub(crate) slot: Slot,
    /// The reader rejoined the interest set: the middleware must be woken.
    pub(crate) wake: bool,
}

impl Inbox {
    /// An inbox for `depth` samples of up to `size` bytes; allocates everything it will ever need.
    pub(crate) fn new(depth: usize, size: usize, keep: Keep) -> Self {
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

    /// Dispatcher: stores a sample. The bytes are copied outside the lock.
    pub(crate) fn deliver(&self, bytes: &[u8], info: &SampleInfo) -> Delivery {
        let refused = |outcome, parked| Delivery { outcome, parked };
        let mut slot = {
            let mut state = self.state.lock();
            if state.closed {
                return refused(Outcome::Closed, false);
            }
            if self.keep != Keep::Newest && state.ring.is_full() {
                let parked = self.keep == Keep::All;
                state.parked = parked;
                return refused(Outcome::NoRoom, parked);
            }
            match state.ring.spare() {
                Some(slot) => slot,
                None => return refused(Outcome::NoRoom, false),
            }
        };
        let fits = slot.fill(bytes, info);
        let mut state = self.state.lock();
        if !fits || state.closed {
            state.ring.give_back(slot);
            let why = if fits {
                Outcome::Closed
            } else {
                Outcome::Oversize
            };
            return refused(why, false);
        }
        let replaced = state.ring.push(slot);
        self.show(&state);
        let parked = self.keep == Keep::All && state.ring.is_full();
        state.parked = parked;
        Delivery {
            outcome: if replaced {
                Outcome::ReplacedOldest
            } else {
                Outcome::Stored
            },
            parked,
        }
    }

    /// Dispatcher: whether the reader stays out of the interest set.
    pub(crate) fn is_parked(&self) -> bool {
        self.state.lock().parked
    }

    /// Worker: the oldest sample. Frees its place in the queue, so that the next one can come
    /// while this one is worked on.
    pub(crate) fn pop(&self) -> Option<Popped> {
        let mut state = self.state.lock();
        let slot = state.ring.pop()?;
        self.show(&state);
        let wake = core::mem::take(&mut state.parked);
        Some(Popped { slot, wake })
    }

    /// Worker: returns the buffer of a popped sample.
    pub(crate) fn give_back(&self, slot: Slot) {
        self.state.lock().ring.give_back(slot);
    }

    /// How many samples wait.
    pub(crate) fn waiting(&self) -> usize {
        self.waiting.load(Ordering::Acquire)
    }

    fn show(&self, state: &State) {
        self.waiting.store(state.ring.len(), Ordering::Release);
    }

    /// Discards what waits. Returns how many samples, and whether the middleware must be woken.
    pub(crate) fn clear(&self) -> (usize, bool) {
        let mut state = self.state.lock();
        let discarded = state.ring.clear();
        self.show(&state);
        (discarded, core::mem::take(&mut state.parked))
    }

    /// Discards what waits and everything that will come. Answers as [`Inbox::clear`].
    pub(crate) fn close(&self) -> (usize, bool) {
        self.state.lock().closed = true;
        self.clear()
    }
}
