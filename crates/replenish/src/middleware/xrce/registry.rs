//! Numbers and slots of objects that come and go, and the deletions that the agent has not been
//! sent. `registry_disabled.rs` takes this file's place without feature `full`.

use crate::middleware::MAX_READERS;
use alloc::vec::Vec;
use replenish_xrce::wire::{ObjectId, StreamId};

/// The highest object number: ids have twelve bits, and 0 is taken by none here.
const LAST: u16 = 0xffe;

/// Object numbers of one kind, given out in turn.
#[derive(Debug, Default)]
pub(super) struct Numbers {
    last: u16,
}

impl Numbers {
    /// The next number that `is_taken` does not know.
    pub(super) fn next(&mut self, is_taken: impl Fn(u16) -> bool) -> Option<u16> {
        for _ in 0..LAST {
            self.last = self.last % LAST + 1;
            if !is_taken(self.last) {
                return Some(self.last);
            }
        }
        None
    }
}

/// The reader of each object number, `u16::MAX` for none.
#[derive(Debug, Default)]
pub(super) struct Slots(Vec<u16>);

impl Slots {
    pub(super) fn get(&self, number: u16) -> u16 {
        let slot = self.0.get(usize::from(number));
        slot.copied().unwrap_or(u16::MAX)
    }

    pub(super) fn set(&mut self, number: u16, slot: u16) {
        let number = usize::from(number);
        if self.0.len() <= number {
            self.0.resize(number + 1, u16::MAX);
        }
        if let Some(entry) = self.0.get_mut(number) {
            *entry = slot;
        }
    }
}

/// Deletions that have not been sent.
#[derive(Debug)]
pub(super) struct PendingDeletes(pub(super) Vec<(ObjectId, Option<StreamId>)>);

impl PendingDeletes {
    pub(super) fn new() -> Self {
        // Each has a subscriber or publisher and may be the last of its topic.
        Self(Vec::with_capacity(6 * MAX_READERS))
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_again_after_all_others() {
        let mut numbers = Numbers::default();
        let free = |_: u16| false;
        assert_eq!(numbers.next(free), Some(1));
        assert_eq!(numbers.next(|n| n == 2), Some(3), "2 is taken");
        for expected in 4..=LAST {
            assert_eq!(numbers.next(free), Some(expected));
        }
        assert_eq!(numbers.next(free), Some(1));
        assert_eq!(numbers.next(|_| true), None);
    }
}
