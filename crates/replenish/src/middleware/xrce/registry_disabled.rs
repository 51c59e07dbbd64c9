//! In the place of `registry` without feature `full`: numbers and slots are given out once, in
//! order.

/// Object numbers of one kind, given out in turn.
#[derive(Debug, Default)]
pub(super) struct Numbers {
    last: u16,
}

impl Numbers {
    pub(super) fn next(&mut self, _: impl Fn(u16) -> bool) -> Option<u16> {
        self.last += 1;
        Some(self.last) // a session keeps fewer objects than there are numbers
    }
}

/// Which reader has an object number: they are given out in the same order, slots from 0 on.
#[derive(Debug, Default)]
pub(super) struct Slots(());

impl Slots {
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn get(&self, number: u16) -> u16 {
        number.wrapping_sub(1)
    }
}

/// Nothing is to be deleted.
#[derive(Debug)]
pub(super) struct PendingDeletes;

impl PendingDeletes {
    pub(super) const fn new() -> Self {
        Self
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn is_empty(&self) -> bool {
        true
    }
}
