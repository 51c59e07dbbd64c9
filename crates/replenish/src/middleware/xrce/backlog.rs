//! Samples of one reader that arrived while its handle had no room.

use super::note::Note;
use crate::middleware::SampleInfo;
use crate::platform::zeroed;
use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;

/// A ring of preallocated slots, oldest first.
#[derive(Debug)]
pub(super) struct Backlog {
    bytes: Box<[u8]>,
    /// Length of the sample in each slot, and what is known about it.
    slots: Vec<(usize, Note)>,
    slot_size: usize,
    head: usize,
    len: usize,
    keep_last: bool,
}

impl Backlog {
    /// Room for `depth` samples (at least one) of up to `max_size` bytes. With `keep_last` a new
    /// sample replaces the oldest when all slots are taken, else it is refused.
    pub(super) fn new(depth: u16, max_size: usize, keep_last: bool) -> Self {
        let depth = usize::from(depth.max(1));
        Self {
            bytes: zeroed(depth * max_size),
            slots: vec![(0, Note::default()); depth],
            slot_size: max_size,
            head: 0,
            len: 0,
            keep_last,
        }
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.len == 0
    }

    pub(super) const fn len(&self) -> usize {
        self.len
    }

    /// Keeps a sample; false if one was lost for it: the oldest, or itself.
    pub(super) fn push(&mut self, info: &SampleInfo, sample: &[u8]) -> bool {
        if sample.len() > self.slot_size {
            return false;
        }
        let full = self.len == self.slots.len();
        if full && !self.keep_last {
            return false;
        }
        if full {
            self.pop();
        }
        let slot = self.wrapped(self.head + self.len);
        let start = slot * self.slot_size;
        if let Some(room) = self.bytes.get_mut(start..start + sample.len()) {
            room.copy_from_slice(sample);
        }
        if let Some(entry) = self.slots.get_mut(slot) {
            *entry = (sample.len(), Note::of(info));
        }
        self.len += 1;
        !full
    }

    /// The oldest sample and what is known about it.
    pub(super) fn front(&self) -> Option<(SampleInfo, &[u8])> {
        let (len, info) = self.slots.get(self.head).filter(|_| self.len > 0)?;
        let start = self.head * self.slot_size;
        Some((info.info(), self.bytes.get(start..start + len)?))
    }

    /// Drops the oldest sample.
    pub(super) const fn pop(&mut self) {
        if self.len > 0 {
            self.head = self.wrapped(self.head + 1);
            self.len -= 1;
        }
    }

    /// A place that is less than one round ahead.
    const fn wrapped(&self, at: usize) -> usize {
        match at.checked_sub(self.slots.len()) {
            Some(at) => at,
            None => at,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drain(backlog: &mut Backlog) -> Vec<Vec<u8>> {
        let mut all = Vec::new();
        while let Some((_, sample)) = backlog.front() {
            all.push(sample.to_vec());
            backlog.pop();
        }
        all
    }

    #[test]
    fn keep_last_drops_the_oldest_and_keep_all_the_newest() {
        let mut last = Backlog::new(2, 4, true);
        assert!(last.push(&SampleInfo::at(1), b"a") && last.push(&SampleInfo::at(2), b"bb"));
        assert!(!last.push(&SampleInfo::at(3), b"ccc"));
        assert!(!last.push(&SampleInfo::at(4), b"too long"));
        assert_eq!(last.front().unwrap().0.arrival, 2);
        assert_eq!(drain(&mut last), [b"bb".to_vec(), b"ccc".to_vec()]);
        assert!(last.is_empty());

        let mut all = Backlog::new(2, 4, false);
        assert!(all.push(&SampleInfo::at(1), b"a") && all.push(&SampleInfo::at(2), b"b"));
        assert!(!all.push(&SampleInfo::at(3), b"c"));
        assert_eq!(drain(&mut all), [b"a".to_vec(), b"b".to_vec()]);
    }
}
