//! The threads of this process that have a budget, to be found by their ids: by the thread itself,
//! by its signal handler, and by a thread that waits for a lock of its.
//!
//! ```text
//!   FIRST ─► Slot ─► Slot ─► …      never freed, used again when thread and enforcer are done
//!              ▲        ▲
//!   MINE ──────┘        └── SlotHandle of the enforcer        MINE: set from the first enrolment
//!   (thread local)                                            to the end of the thread
//! ```
//!
//! Places live for ever, so that no reference to one can dangle, even if an owner forgets to let
//! go.

use super::retry::Retry;
use super::suspension::Suspension;
use super::tid::current_tid;
use std::cell::Cell;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicI32, AtomicU16, AtomicU32, Ordering};

static FIRST: OnceLock<&'static Slot> = OnceLock::new();

thread_local! {
    /// The place of the calling thread. Without a destructor: a signal handler reads it.
    static MINE: Cell<Option<&'static Slot>> = const { Cell::new(None) };
    /// Gives the place back at the end of the thread.
    static AT_END: Cell<Option<AtEnd>> = const { Cell::new(None) };
}

/// One place.
#[derive(Debug)]
pub(super) struct Slot {
    pub(super) suspension: Suspension,
    pub(super) retry: Retry,
    pub(super) demand: Demand,
    /// The thread, 0 once it has ended.
    tid: AtomicI32,
    /// The thread and every handle. At 0 the place is free.
    users: AtomicU32,
    next: OnceLock<&'static Slot>,
}

/// The low priority that the thread is to give itself, since the kernel refuses it to the enforcer.
#[derive(Debug)]
pub(super) struct Demand(AtomicU16);

impl Demand {
    const NONE: u16 = u16::MAX;

    const fn new() -> Self {
        Self(AtomicU16::new(Self::NONE))
    }

    pub(super) fn make(&self, priority: u8) {
        self.0.store(priority.into(), Ordering::Release);
    }

    pub(super) fn withdraw(&self) {
        self.0.store(Self::NONE, Ordering::Release);
    }

    /// Takes the priority, once; called by the thread itself. Async-signal-safe.
    pub(super) fn take(&self) -> Option<u8> {
        u8::try_from(self.0.swap(Self::NONE, Ordering::AcqRel)).ok()
    }
}

/// The enforcer's hold on a place: as long as there is one no other thread gets it.
#[derive(Debug)]
pub(super) struct SlotHandle(&'static Slot);

impl SlotHandle {
    /// The place of the calling thread, its first one or the one that it has. Allocates.
    pub(super) fn mine() -> Self {
        let slot = mine().unwrap_or_else(|| {
            let slot = take();
            slot.tid.store(current_tid().get(), Ordering::Release);
            MINE.set(Some(slot));
            AT_END.set(Some(AtEnd));
            slot
        });
        slot.users.fetch_add(1, Ordering::Relaxed);
        Self(slot)
    }

    pub(super) fn suspension(&self) -> &Suspension {
        &self.0.suspension
    }

    pub(super) fn retry(&self) -> &Retry {
        &self.0.retry
    }

    pub(super) fn demand(&self) -> &Demand {
        &self.0.demand
    }
}

impl Drop for SlotHandle {
    fn drop(&mut self) {
        self.0.users.fetch_sub(1, Ordering::Release);
    }
}

struct AtEnd;

impl Drop for AtEnd {
    fn drop(&mut self) {
        if let Some(slot) = MINE.take() {
            slot.retry.drop_timer();
            slot.tid.store(0, Ordering::Release);
            slot.users.fetch_sub(1, Ordering::Release);
        }
    }
}

/// The place of the calling thread, if it has ever had a budget.
#[inline]
pub(super) fn mine() -> Option<&'static Slot> {
    MINE.get()
}

/// The place of thread `tid`.
pub(super) fn find(tid: i32) -> Option<&'static Slot> {
    let mut next = FIRST.get();
    while let Some(slot) = next {
        if slot.tid.load(Ordering::Acquire) == tid {
            return Some(slot);
        }
        next = slot.next.get();
    }
    None
}

/// A free place, or a new one at the end; it has one user.
fn take() -> &'static Slot {
    let mut link = &FIRST;
    let mut new = None;
    loop {
        while let Some(slot) = link.get() {
            let (success, failure) = (Ordering::Acquire, Ordering::Relaxed);
            if slot.users.compare_exchange(0, 1, success, failure).is_ok() {
                slot.suspension.reset();
                slot.demand.withdraw();
                return slot;
            }
            link = &slot.next;
        }
        let slot = *new.get_or_insert_with(|| {
            &*Box::leak(Box::new(Slot {
                suspension: Suspension::new(),
                retry: Retry::new(),
                demand: Demand::new(),
                tid: AtomicI32::new(0),
                users: AtomicU32::new(1),
                next: OnceLock::new(),
            }))
        });
        // Fails if another thread appended its own meanwhile: then that one is looked at, too.
        if link.set(slot).is_ok() {
            return slot;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A place that a thread has left is used again; a place that a thread holds is not.
    #[test]
    fn places_are_used_again_when_nobody_has_them() {
        let in_a_thread = |f: fn() -> SlotHandle| std::thread::spawn(f).join().unwrap();
        let kept = in_a_thread(SlotHandle::mine);
        assert_eq!(
            kept.0.tid.load(Ordering::Relaxed),
            0,
            "its thread has ended"
        );
        let count = || {
            let mut next = FIRST.get();
            let mut places = 0;
            while let Some(slot) = next {
                places += 1;
                next = slot.next.get();
            }
            places
        };
        for _ in 0..if cfg!(miri) { 5 } else { 100 } {
            let other = in_a_thread(|| {
                let first = SlotHandle::mine();
                let again = SlotHandle::mine();
                assert!(std::ptr::eq(first.0, again.0), "one thread, one place");
                assert!(find(current_tid().get()).is_some_and(|s| std::ptr::eq(s, first.0)));
                again
            });
            assert!(!std::ptr::eq(kept.0, other.0), "another one holds it");
        }
        assert!(count() < 50, "{} places for three threads", count());
    }
}
