//! The handles of a worker's next round: those that were marked, and those whose release is due.
//!
//! ```text
//!   marks (by slot) ──► due (by position, that is in the order of execution) ──► looked at ──┐
//!   releases (by position), the earliest known ──► due when its time has come                │
//!        ▲                                     ▲ again, if there is more                     │
//!        └─────────────────────────────────────┴─────────────────────────────────────────────┘
//! ```
//!
//! A *slot* is a handle's for as long as it lives; its *position* changes when others come and go.

use super::lazy_now::LazyNow;
use crate::Nanos;
use crate::handoff::ReadySet;
use alloc::vec::Vec;

/// Positions per word.
const BITS: usize = usize::BITS as usize;

/// The queue of one worker; lives on its thread. Allocates only when it is made.
pub(crate) struct RunQueue {
    /// Positions by slot.
    positions: Vec<usize>,
    /// A bit per position.
    due: Vec<usize>,
    /// Releases by position; `Nanos::MAX` if there is none.
    releases: Vec<Nanos>,
    /// The earliest of them, or earlier.
    earliest: Nanos,
    /// The function by which releases become due; set with the first one, so that programs without
    /// any do not carry the code.
    by_time: Option<fn(&mut Self, &LazyNow)>,
}

impl RunQueue {
    /// The queue of a worker that has up to `limit` handles, in slots below that.
    pub(crate) fn new(limit: usize) -> Self {
        // Zeros, which take less code, until they are put in order.
        let mut run_queue = Self {
            positions: alloc::vec![0; limit],
            due: alloc::vec![0; limit.div_ceil(BITS)],
            releases: alloc::vec![0; limit],
            earliest: 0,
            by_time: None,
        };
        run_queue.reorder(&mut core::iter::empty());
        run_queue
    }

    /// Handles have come or gone, or the worker begins: everything is looked at once.
    /// `slots`: the slots of the handles, by position.
    #[inline(never)]
    pub(crate) fn reorder(&mut self, slots: &mut dyn Iterator<Item = usize>) {
        self.positions.fill(usize::MAX);
        self.releases.fill(Nanos::MAX);
        self.earliest = Nanos::MAX;
        self.due.fill(0);
        for (at, slot) in slots.enumerate() {
            if let Some(position) = self.positions.get_mut(slot) {
                *position = at;
            }
            self.insert(at);
        }
    }

    /// Releases up to `now` are due.
    pub(crate) fn release(&mut self, now: &LazyNow) {
        if let Some(by_time) = self.by_time {
            by_time(self, now);
        }
    }

    fn by_time(&mut self, now: &LazyNow) {
        if self.earliest == Nanos::MAX || self.earliest > now.get() {
            return;
        }
        let now = now.get();
        let Self { releases, due, .. } = self;
        for (at, _) in releases.iter().enumerate().filter(|(_, r)| **r <= now) {
            set(due, at);
        }
    }

    /// The first handle from position `from` on that is to be looked at, with what was marked
    /// meanwhile. It is not due any more.
    pub(crate) fn next_from(&mut self, from: usize, marks: &ReadySet) -> Option<usize> {
        let Self { positions, due, .. } = self;
        marks.drain(|slot| {
            if let Some(at) = positions.get(slot) {
                set(due, *at);
            }
        });
        let mut above = !0 << (from % BITS);
        for (word, bits) in due.iter_mut().enumerate().skip(from / BITS) {
            let wanted = *bits & core::mem::replace(&mut above, !0);
            if wanted != 0 {
                let bit = wanted.trailing_zeros();
                *bits &= !(1 << bit);
                return Some(word * BITS + bit as usize);
            }
        }
        None
    }

    /// The position of the handle in this slot.
    pub(crate) fn position(&self, slot: usize) -> Option<usize> {
        let position = self.positions.get(slot).copied();
        position.filter(|at| *at != usize::MAX)
    }

    /// The handle at this position is to be looked at (again).
    pub(crate) fn insert(&mut self, at: usize) {
        set(&mut self.due, at);
    }

    /// The handle at this position was looked at; this is its next release.
    pub(crate) fn next_release_of(&mut self, at: usize, release: Option<Nanos>) {
        self.by_time = Some(Self::by_time);
        let new = release.unwrap_or(Nanos::MAX);
        let Some(known) = self.releases.get_mut(at) else {
            return;
        };
        let old = core::mem::replace(known, new);
        if new < self.earliest {
            self.earliest = new;
        } else if old <= self.earliest && new != old {
            self.earliest = self.releases.iter().copied().min().unwrap_or(Nanos::MAX);
        }
    }

    /// Whether anything is known to be due. Marks that were not drained are not known.
    pub(crate) fn is_due(&self) -> bool {
        self.due.iter().any(|bits| *bits != 0)
    }

    /// The earliest release.
    pub(crate) fn earliest(&self) -> Option<Nanos> {
        Some(self.earliest).filter(|at| *at != Nanos::MAX)
    }
}

/// Positions beyond the last are ignored.
fn set(bits: &mut [usize], at: usize) {
    if let Some(word) = bits.get_mut(at / BITS) {
        *word |= 1 << (at % BITS);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run_queue(limit: usize) -> (RunQueue, ReadySet) {
        let mut run_queue = RunQueue::new(limit);
        // Slots in reverse order of positions.
        for (slot, position) in run_queue.positions.iter_mut().enumerate() {
            *position = limit - 1 - slot;
        }
        (run_queue, ReadySet::new(limit))
    }

    #[test]
    fn marks_come_in_the_order_of_positions_and_earlier_ones_in_the_next_round() {
        let (mut run_queue, marks) = run_queue(200);
        for slot in [0, 70, 199, 200, 9999] {
            marks.mark(slot);
        }
        assert_eq!(run_queue.next_from(0, &marks), Some(0));
        marks.mark(198); // position 1: ahead of the round
        assert_eq!(run_queue.next_from(1, &marks), Some(1));
        assert_eq!(run_queue.next_from(2, &marks), Some(129));
        marks.mark(199); // position 0: behind it
        assert_eq!(run_queue.next_from(130, &marks), Some(199));
        assert_eq!(run_queue.next_from(200, &marks), None);
        assert!(run_queue.is_due());
        assert_eq!(run_queue.next_from(0, &marks), Some(0));
        assert_eq!(run_queue.next_from(1, &marks), None);
        assert!(!run_queue.is_due());
    }

    #[test]
    fn a_round_does_not_go_back_within_a_word_either() {
        let (mut run_queue, marks) = run_queue(8);
        for at in [0, 2, 5] {
            run_queue.insert(at);
        }
        assert_eq!(run_queue.next_from(1, &marks), Some(2));
        assert_eq!(run_queue.next_from(3, &marks), Some(5));
        assert_eq!(run_queue.next_from(6, &marks), None);
        assert_eq!(run_queue.next_from(0, &marks), Some(0));
    }

    #[test]
    fn releases_are_due_at_their_time_and_the_earliest_is_known() {
        let (mut run_queue, marks) = run_queue(3);
        assert_eq!(run_queue.earliest(), None);
        run_queue.next_release_of(1, Some(20));
        run_queue.next_release_of(2, Some(10));
        run_queue.release(&LazyNow::at(9));
        assert_eq!(run_queue.next_from(0, &marks), None);
        run_queue.release(&LazyNow::at(10));
        assert_eq!(run_queue.next_from(0, &marks), Some(2));
        run_queue.next_release_of(2, Some(30));
        assert_eq!(run_queue.earliest(), Some(20));
        run_queue.next_release_of(1, None);
        assert_eq!(run_queue.earliest(), Some(30));
        run_queue.next_release_of(7, Some(1)); // no such position
        assert_eq!(run_queue.earliest(), Some(30));
    }
}
