//! Locks with priority inheritance (Sha, Rajkumar, Lehoczky, IEEE Trans. Computers 1990), over
//! chains of locks, with hand-over to the most urgent waiter.
//!
//! As Linux does it, a thread that inherits joins its new equals at the tail, and one that gives
//! the inheritance back at the head.

use super::phase::{Phase, Rank};
use super::simulation::Sim;
use crate::{End, LockId, What};

impl Sim<'_> {
    /// A thread's own urgency, or that of the most urgent thread that waits for it.
    pub(super) fn inherited_rank(&self, id: usize) -> Option<Rank> {
        let state = &self.states[id];
        let waiters = state
            .held
            .iter()
            .flat_map(|&lock| &self.locks[lock].waiters);
        // Waiters' ranks include what they inherit themselves.
        waiters
            .map(|&waiter| self.states[waiter].rank)
            .fold(state.base_rank(), Option::max)
    }

    pub(super) fn lock(&mut self, id: usize, lock: LockId) {
        let Some(owner) = self.locks[lock].owner else {
            self.take(id, lock);
            return;
        };
        if self.waits_for(owner, id) {
            self.deadlock = Some(id);
            return;
        }
        self.locks[lock].waiters.push(id);
        self.states[id].phase = Phase::LockWait(lock);
        self.note(id, What::LockWait { lock });
        self.block_budget(id);
        self.refresh(id, End::Tail);
        self.refresh(owner, End::Tail);
    }

    pub(super) fn unlock(&mut self, id: usize, lock: LockId) {
        self.note(id, What::Unlocked { lock });
        self.states[id].held.retain(|&held| held != lock);
        self.locks[lock].owner = None;
        // The first of the most urgent.
        let mut next = None;
        for &waiter in &self.locks[lock].waiters {
            let rank = self.states[waiter].rank;
            if next.is_none_or(|(best, _)| rank > best) {
                next = Some((rank, waiter));
            }
        }
        if let Some((_, next)) = next {
            self.locks[lock].waiters.retain(|&waiter| waiter != next);
            self.take(next, lock);
            self.wake(next);
        }
        self.refresh(id, End::Head);
    }

    fn take(&mut self, id: usize, lock: LockId) {
        self.locks[lock].owner = Some(id);
        self.states[id].held.push(lock);
        self.note(id, What::Locked { lock });
    }

    /// Whether `id`, over a chain of locks, waits for `whom`.
    fn waits_for(&self, mut id: usize, whom: usize) -> bool {
        // A chain cannot be longer than there are locks: no circle was ever closed.
        for _ in 0..=self.locks.len() {
            if id == whom {
                return true;
            }
            let Phase::LockWait(lock) = self.states[id].phase else {
                return false;
            };
            match self.locks[lock].owner {
                Some(owner) => id = owner,
                None => return false,
            }
        }
        true
    }
}
