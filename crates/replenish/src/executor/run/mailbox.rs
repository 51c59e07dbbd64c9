//! What is asked of a running worker from outside: handles that come and go.
//!
//! ```text
//!   any thread                               worker, between two callbacks
//!   add: build the entry ── post ──► orders ──► insert, begin
//!   remove: removed := true ─ post ─► orders ──► take out ──► attic, gone := set
//!           wait for gone ◄──────────────────────────────────────┘
//!   drop what is in the attic        (memory is freed here, not on the worker)
//! ```
//!
//! Everything is preallocated: so many entries per worker, in its hands, under way or in the attic.

use super::worker::Worker;
use crate::executor::handles::entry::{HandleEntry, insert};
use crate::executor::handles::handle::HandleState;
use crate::executor::wake::doorbell::{Doorbell, Line};
use crate::sync::{Arc, AtomicBool, Mutex, Ordering};
use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec::Vec;
use replenish_os::{Tid, clock, current_tid};

/// The way to one worker.
pub(crate) struct Mailbox {
    waiting: AtomicBool,
    post: Mutex<Post>,
    limit: usize,
    bell: Arc<Doorbell>,
}

struct Post {
    orders: VecDeque<Order>,
    attic: Vec<HandleEntry>,
    /// Slots that no entry has: in the worker's hands, under way, or in the attic.
    free: Vec<usize>,
    worker: Option<Tid>,
    closed: bool,
}

pub(crate) enum Order {
    Add(HandleEntry),
    Remove(Arc<HandleState>),
}

/// Why an order was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Declined {
    Full { limit: usize },
    Stopped,
}

impl Mailbox {
    /// For a worker with `used` handles, in the first slots, that may have `limit`.
    pub(crate) fn new(used: usize, limit: usize, bell: Arc<Doorbell>) -> Arc<Self> {
        Arc::new(Self {
            waiting: AtomicBool::new(false),
            post: Mutex::new(Post {
                orders: VecDeque::with_capacity(2 * limit),
                attic: Vec::with_capacity(limit),
                free: (used..limit).rev().collect(),
                worker: None,
                closed: false,
            }),
            limit,
            bell,
        })
    }

    /// Whether the caller is the worker itself.
    pub(crate) fn is_mine(&self) -> bool {
        self.post.lock().worker == Some(current_tid())
    }

    /// The line to the handle in `slot`.
    pub(crate) fn line(&self, slot: usize) -> Line {
        Line {
            bell: Arc::clone(&self.bell),
            slot,
        }
    }

    /// Keeps a place for one entry: its slot.
    pub(crate) fn reserve(&self) -> Result<usize, Declined> {
        let mut post = self.post.lock();
        if post.closed {
            return Err(Declined::Stopped);
        }
        let limit = self.limit;
        post.free.pop().ok_or(Declined::Full { limit })
    }

    /// Gives a reserved place back.
    pub(crate) fn unreserve(&self, slot: usize) {
        self.post.lock().free.push(slot);
    }

    /// Hands an order to the worker; for an entry, a place was reserved.
    pub(crate) fn send(&self, order: Order) -> Result<(), Declined> {
        self.put(order).map_err(|_| Declined::Stopped)
    }

    /// As [`send`](Self::send); what is declined comes back, to be dropped where it does no harm.
    pub(crate) fn put(&self, order: Order) -> Result<(), Box<Order>> {
        {
            let mut post = self.post.lock();
            if post.closed {
                return Err(Box::new(order));
            }
            post.orders.push_back(order);
            self.waiting.store(true, Ordering::Release);
        }
        self.bell.call();
        Ok(())
    }

    /// Frees what the worker has let go of, unless it is the worker who asks.
    pub(crate) fn sweep(&self) {
        if !self.is_mine() {
            self.clear();
        }
    }

    /// Frees it whoever asks: for those who are about to allocate anyway. A worker whose own
    /// callbacks add and remove would run out of places otherwise.
    pub(crate) fn clear(&self) {
        loop {
            let entry = {
                let mut post = self.post.lock();
                let entry = post.attic.pop();
                post.free.extend(entry.as_ref().map(|e| e.slot));
                entry
            };
            if entry.is_none() {
                return;
            }
        }
    }

    /// Worker: it is this thread that runs.
    pub(crate) fn open(&self) {
        self.post.lock().worker = Some(current_tid());
    }

    /// Worker: whether something was asked.
    pub(crate) fn is_waiting(&self) -> bool {
        self.waiting.load(Ordering::Acquire)
    }

    /// Worker: does what was asked.
    pub(crate) fn empty(&self, worker: &mut Worker) {
        if !self.is_waiting() {
            return;
        }
        self.waiting.store(false, Ordering::Relaxed);
        loop {
            let Some(order) = self.post.lock().orders.pop_front() else {
                return;
            };
            match order {
                Order::Add(mut entry) => {
                    let line = self.line(entry.slot);
                    entry.handle.begin(clock::monotonic(), &line);
                    insert(&mut worker.spec.entries, entry);
                    worker.reordered();
                }
                Order::Remove(shared) => {
                    let mut entries = worker.spec.entries.iter();
                    let at = entries.position(|e| Arc::ptr_eq(&e.shared, &shared));
                    if let Some(at) = at {
                        let entry = worker.spec.entries.remove(at);
                        worker.reordered();
                        self.post.lock().attic.push(entry);
                    }
                    shared.gone.set();
                }
            }
        }
    }

    /// Worker: it ends; nobody waits for it any more.
    pub(crate) fn close(&self) {
        let mut post = self.post.lock();
        post.closed = true;
        for order in &post.orders {
            if let Order::Remove(shared) = order {
                shared.gone.set();
            }
        }
    }
}
