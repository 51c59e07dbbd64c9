//! The way to a running worker from outside: handles that come and go.
//!
//! ```text
//!   any thread                                  worker, between two callbacks
//!   add: build the entry ──────► commands ────► insert, begin
//!   remove: removed := true ───► commands ────► take out ──► drop the callback
//!           wait for gone ◄──────────────────── gone := set ◄── retired: its slot is free
//!   trigger ──────► swap ──────► commands ────► swap with the old one, which the sender drops
//! ```
//!
//! Everything is preallocated: each of a worker's slots belongs to an entry in its hands, on its
//! way or retired, or is free. [`CommandQueue`] has the protocol.

use crate::executor::handles::entry::HandleEntry;
use crate::executor::handles::state::HandleState;
use crate::executor::run::rules::Trigger;
use crate::executor::wake::doorbell::{Doorbell, WakeHandle};
use crate::handoff::{CommandQueue, Declined, Reservation};
use crate::platform;
use crate::sync::{Arc, Mutex};
use alloc::boxed::Box;
use alloc::vec::Vec;
use replenish_os::{Tid, current_tid};

/// A change that a running worker is to make.
#[allow(
    clippy::large_enum_variant,
    reason = "commands are rare, and the worker would have to free a box"
)]
pub(crate) enum Command {
    Add(HandleEntry),
    Remove(Arc<HandleState>),
    Trigger(Arc<TriggerSwap>),
}

/// A trigger on its way to a worker, and then the one that it has replaced on its way back.
pub(crate) struct TriggerSwap(Mutex<Option<Trigger>>);

impl TriggerSwap {
    /// Worker: takes the new trigger and leaves the old one, so that it frees no memory.
    pub(super) fn swap(&self, trigger: &mut Trigger) {
        if let Some(place) = &mut *self.0.lock() {
            core::mem::swap(place, trigger);
        }
    }
}

/// The closure of a trigger may panic as it is dropped.
impl Drop for TriggerSwap {
    fn drop(&mut self) {
        let drops = |swap: &mut Self| {
            let trigger = swap.0.lock().take();
            drop(trigger); // without the lock
        };
        platform::guard(self, drops, |_, _| ());
    }
}

/// Triggers that may be on their way at a time.
const TRIGGERS: usize = 16;

/// Reason why a trigger was not sent.
pub(crate) enum NotSent {
    /// The worker has ended.
    Ended,
    /// This many triggers are on their way already.
    TooMany(usize),
}

/// The way to one worker.
pub(crate) struct Mailbox {
    queue: CommandQueue<Command, HandleEntry>,
    /// Triggers on their way, and those that came back.
    swaps: Mutex<Vec<Arc<TriggerSwap>>>,
    worker: Mutex<Option<Tid>>,
    bell: Arc<Doorbell>,
}

impl Mailbox {
    /// The mailbox of a worker that has `used` handles, in the first slots, and may have `limit`.
    pub(crate) fn new(used: usize, limit: usize, bell: Arc<Doorbell>) -> Arc<Self> {
        Arc::new(Self {
            queue: CommandQueue::new(used..limit, 2 * limit + TRIGGERS),
            swaps: Mutex::new(Vec::new()),
            worker: Mutex::new(None),
            bell,
        })
    }

    /// Whether the caller is the worker itself.
    pub(crate) fn is_mine(&self) -> bool {
        *self.worker.lock() == Some(current_tid())
    }

    /// Wakes the worker for the handle in `slot`.
    pub(crate) fn wake_handle(&self, slot: usize) -> WakeHandle {
        WakeHandle::new(&self.bell, slot)
    }

    /// Reserves a slot for one entry.
    pub(crate) fn reserve(&self) -> Result<Reservation<'_, Command, HandleEntry>, Declined> {
        self.queue.reserve()
    }

    /// Adds `entry`, which has the reserved slot; or gives it back, to be dropped where it does no
    /// harm, if the worker has ended.
    pub(crate) fn add(
        &self,
        reserved: Reservation<'_, Command, HandleEntry>,
        entry: HandleEntry,
    ) -> Result<(), Box<Command>> {
        reserved.push(Command::Add(entry)).map_err(Box::new)?;
        self.bell.force();
        Ok(())
    }

    /// Asks the worker to let go of a handle; `false` if the worker has ended.
    pub(crate) fn remove(&self, shared: &Arc<HandleState>) -> bool {
        let sent = self.queue.push(Command::Remove(Arc::clone(shared)));
        if sent.is_ok() {
            self.bell.force();
        }
        sent.is_ok()
    }

    /// Sends another trigger; drops those that came back.
    pub(crate) fn set_trigger(&self, trigger: Trigger) -> Result<(), NotSent> {
        let swap = Arc::new(TriggerSwap(Mutex::new(Some(trigger))));
        let mut back = Vec::new();
        {
            let mut swaps = self.swaps.lock();
            // The worker is done with triggers that only this list still holds.
            while let Some(at) = swaps.iter().position(|s| Arc::strong_count(s) == 1) {
                back.push(swaps.swap_remove(at));
            }
            if swaps.len() >= TRIGGERS {
                return Err(NotSent::TooMany(TRIGGERS));
            }
            let sent = self.queue.push(Command::Trigger(Arc::clone(&swap)));
            sent.map_err(|_| NotSent::Ended)?;
            swaps.push(swap);
        }
        drop(back); // without the lock: closures of the user are dropped here
        self.bell.force();
        Ok(())
    }

    /// Frees what the worker has retired, unless the caller is the worker.
    pub(crate) fn sweep(&self) {
        if !self.is_mine() {
            self.free_retired();
        }
    }

    /// Frees what the worker has retired, also on the worker: for callers that are about to
    /// allocate anyway. A worker whose own callbacks add and remove would run out of slots
    /// otherwise.
    pub(crate) fn free_retired(&self) {
        self.queue.free_retired();
    }

    /// Worker: the calling thread is the worker.
    pub(crate) fn open(&self) {
        *self.worker.lock() = Some(current_tid());
    }

    /// Worker: whether a command waits.
    pub(crate) fn is_waiting(&self) -> bool {
        self.queue.is_waiting()
    }

    /// Worker: the next command.
    pub(crate) fn next(&self) -> Option<Command> {
        self.queue.next()
    }

    /// Worker: does not use `entry` any more.
    pub(crate) fn retire(&self, entry: HandleEntry) {
        self.queue.retire(entry.slot, entry, |_| ());
    }

    /// Worker: it ends. No command comes any more; those that wait are left to it.
    pub(crate) fn close(&self) {
        self.queue.close(|_| ());
    }
}
