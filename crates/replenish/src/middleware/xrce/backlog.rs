//! Samples of one reader that arrived while its handle had no room, and how many more its agent may
//! send.

use super::note::Note;
use crate::middleware::SampleInfo;
use crate::platform::{FULL, zeroed};
use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;
use replenish_xrce::wire::{DeliveryControl, RequestId, StreamId};

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

/// The samples that a keep-all reader has asked of its agent: never more than it has room for.
///
/// The agent counts what it sends, the reader what arrives, and both have to come to the same. A
/// sample names the READ that asked for it, and samples come in order: the first one of a READ says
/// that nothing of the READ before is still to come, even if some of it was lost on the way.
pub(super) struct Flow {
    pub(super) stream: StreamId,
    pub(super) control: DeliveryControl,
    /// Samples it can keep.
    pub(super) depth: usize,
    /// Samples of the last READ that may still come.
    granted: u16,
    /// Samples of the READ before it that may still come.
    stale: u16,
    /// The READ that asked for the last sample.
    request: RequestId,
    /// Samples of the last READ have begun to come.
    begun: bool,
}

impl Flow {
    /// The first READ asked for `depth` samples.
    pub(super) const fn new(stream: StreamId, control: DeliveryControl, depth: u16) -> Self {
        Self {
            stream,
            control,
            depth: depth as usize,
            granted: depth,
            stale: 0,
            request: RequestId::NONE,
            begun: false,
        }
    }

    /// A sample has come, or is known to be lost, that `request` asked for.
    pub(super) fn arrived(&mut self, request: RequestId) {
        if FULL && request != self.request {
            self.request = request;
            self.begun = true;
            self.stale = 0;
        }
        let of_read = if self.begun || !FULL {
            &mut self.granted
        } else {
            &mut self.stale
        };
        *of_read = of_read.saturating_sub(1);
    }

    /// Samples that may still come.
    pub(super) const fn expected(&self) -> usize {
        let stale = if FULL { self.stale } else { 0 };
        self.granted as usize + stale as usize
    }

    /// Whether it is time to ask for more: half of what there is room for has come. Only one READ
    /// is under way at a time.
    pub(super) const fn is_spent(&self) -> bool {
        self.expected() == 0 || (FULL && self.begun && self.expected() <= self.depth / 2)
    }

    /// Another READ asks for `samples`.
    pub(super) const fn asked(&mut self, samples: u16) {
        if FULL {
            self.stale = self.granted;
            self.begun = false;
        }
        self.granted = samples;
    }

    /// The agent was lost, and with it all READs.
    pub(super) const fn lost(&mut self) {
        self.granted = 0;
        if FULL {
            self.stale = 0;
            self.request = RequestId::NONE;
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

    /// A reader, and the samples that its agent has sent and that have not arrived.
    struct Way {
        flow: Flow,
        /// By READ, in the order in which they were sent.
        under_way: std::collections::VecDeque<RequestId>,
        request: RequestId,
        left: u16,
    }

    /// b209253 counted down what came and asked again at 0: a sample that the agent had sent and
    /// the reader could not put together left both waiting for ever.
    #[test]
    fn samples_that_get_lost_on_the_way_stop_no_reader_and_none_comes_too_many() {
        let mut seed = 1_u64;
        let mut random = move |below: u64| {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            seed % below
        };
        for depth in [8_u16, 10, 257] {
            let mut way = Way {
                flow: Flow::new(StreamId::RELIABLE, DeliveryControl::UNLIMITED, depth),
                under_way: std::collections::VecDeque::new(),
                request: RequestId(10),
                left: depth,
            };
            let mut arrived = 0;
            for _ in 0..100_000 {
                match random(4) {
                    0 | 1 if way.left > 0 => {
                        way.left -= 1;
                        way.under_way.push_back(way.request);
                    }
                    2 => {
                        if let Some(request) = way.under_way.pop_front()
                            && random(50) > 0
                        {
                            way.flow.arrived(request);
                            arrived += 1;
                        }
                    }
                    _ if way.flow.is_spent() => {
                        let room = usize::from(depth).saturating_sub(way.flow.expected());
                        if room >= usize::from(depth).div_ceil(2) {
                            way.flow.asked(room as u16);
                            (way.request, way.left) = (RequestId(way.request.0 + 1), room as u16);
                        }
                    }
                    _ => {}
                }
                assert!(way.under_way.len() <= usize::from(depth), "one too many");
            }
            assert!(arrived > 10_000, "depth {depth}: stopped after {arrived}");
        }
    }
}
