//! The sending half of data writers, requesters and repliers.

use super::qos::Qos;
use super::topics::TopicId;
use crate::flow::{Charge, Ledger, Sample, TrackerHandle, shrink};
use crate::report::Counters;
use replenish_xrce::Nanos;
use std::collections::VecDeque;

/// Bytes that a kept sample is counted with besides its own: it and its place.
const KEPT_OVERHEAD: usize =
    Sample::OVERHEAD + shrink::SPARE * size_of::<(Sample, TrackerHandle, Charge)>();

/// The sending half of an entity.
#[derive(Debug)]
pub(crate) struct Writer {
    pub(crate) topic: TopicId,
    pub(crate) qos: Qos,
    /// Its topic is that of boards' recordings.
    pub(crate) records: bool,
    /// The last samples, for readers that come later; the oldest first.
    history: VecDeque<(Sample, Charge)>,
    /// Samples for returning readers; the oldest first.
    stash: VecDeque<(Sample, TrackerHandle, Charge)>,
    last: Option<Nanos>,
    pub(crate) written: u64,
    pub(crate) written_bytes: u64,
}

impl Writer {
    pub(crate) fn new(topic: TopicId, qos: Qos, records: bool) -> Self {
        Self {
            topic,
            qos,
            records,
            history: VecDeque::new(),
            stash: VecDeque::new(),
            last: None,
            written: 0,
            written_bytes: 0,
        }
    }

    /// A payload of `bytes` was written.
    pub(crate) fn wrote(&mut self, now: Nanos, bytes: usize, counters: &Counters) {
        let late = |last: Nanos, deadline: Nanos| now > last.saturating_add(deadline);
        if let (Some(last), Some(deadline)) = (self.last, self.qos.deadline)
            && late(last, deadline)
        {
            counters.deadlines_missed.hit();
        }
        self.last = Some(now);
        self.written += 1;
        self.written_bytes += bytes as u64;
    }

    /// Whether samples have to be kept.
    pub(crate) fn keeps(&self) -> bool {
        self.qos.is_durable()
    }

    /// Keeps a sample for readers that come later, as far as there is room.
    pub(crate) fn keep(&mut self, sample: &Sample, ledger: &Ledger) {
        while self.history.len() >= self.qos.depth.max(1) {
            shrink::pop_front(&mut self.history);
        }
        let bytes = sample.len() + KEPT_OVERHEAD;
        while !self.history.is_empty() && ledger.free() < bytes {
            shrink::pop_front(&mut self.history);
        }
        if let Some(charge) = ledger.charge(bytes) {
            self.history.push_back((sample.clone(), charge));
        }
    }

    /// Keeps a sample for returning readers, as far as there is room.
    pub(crate) fn stash(
        &mut self,
        sample: &Sample,
        tracker: &TrackerHandle,
        most: usize,
        ledger: &Ledger,
    ) {
        if self.stash.len() < most
            && let Some(charge) = ledger.charge(sample.len() + KEPT_OVERHEAD)
        {
            self.stash
                .push_back((sample.clone(), tracker.clone(), charge));
        }
    }

    /// Whether samples are kept for returning readers.
    pub(crate) fn has_stash(&self) -> bool {
        !self.stash.is_empty()
    }

    /// Drops the samples for returning readers.
    pub(crate) fn clear_stash(&mut self) {
        self.stash = VecDeque::new();
    }

    /// The samples for a new reader, the oldest first: all since its loss for one that `returns`,
    /// otherwise the history for a durable one.
    pub(crate) fn for_late(
        &self,
        now: Nanos,
        durable: bool,
        returns: bool,
    ) -> Vec<(Sample, Option<TrackerHandle>)> {
        let stash = self.stash.iter().filter(|_| returns);
        let stash = stash.map(|(sample, tracker, _)| (sample, Some(tracker)));
        let all_stashed = returns && self.has_stash();
        let kept = durable && self.keeps() && !all_stashed;
        let history = self.history.iter().filter(|_| kept);
        let history = history.map(|(sample, _)| (sample, None));
        let alive = history.chain(stash);
        let alive = alive.filter(|(sample, _)| !sample.is_expired(now));
        alive
            .map(|(sample, tracker)| (sample.clone(), tracker.cloned()))
            .collect()
    }
}
