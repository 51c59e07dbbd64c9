//! The sending half of data writers, requesters and repliers.

use super::qos::Qos;
use crate::config::Nanos;
use crate::sample::{Charge, Ledger, Sample};
use crate::stats::Counters;
use crate::topics::TopicId;
use std::collections::VecDeque;

/// The sending half of an entity.
#[derive(Debug)]
pub(crate) struct Writer {
    pub(crate) topic: TopicId,
    pub(crate) qos: Qos,
    /// The last samples, for readers that come later; the oldest first.
    history: VecDeque<(Sample, Charge)>,
    last: Option<Nanos>,
    pub(crate) written: u64,
}

impl Writer {
    pub(crate) fn new(topic: TopicId, qos: Qos) -> Self {
        Self {
            topic,
            qos,
            history: VecDeque::new(),
            last: None,
            written: 0,
        }
    }

    /// Something was written.
    pub(crate) fn wrote(&mut self, now: Nanos, counters: &Counters) {
        let late = |last: Nanos, deadline: Nanos| now > last.saturating_add(deadline);
        if let (Some(last), Some(deadline)) = (self.last, self.qos.deadline)
            && late(last, deadline)
        {
            counters.deadlines_missed.hit();
        }
        self.last = Some(now);
        self.written += 1;
    }

    /// Whether samples have to be kept.
    pub(crate) fn keeps(&self) -> bool {
        self.qos.is_durable()
    }

    /// Keeps a sample for readers that come later, as far as there is room.
    pub(crate) fn keep(&mut self, sample: &Sample, ledger: &Ledger) {
        while self.history.len() >= self.qos.depth.max(1) {
            self.history.pop_front();
        }
        while !self.history.is_empty() && ledger.free() < sample.len() {
            self.history.pop_front();
        }
        if let Some(charge) = ledger.charge(sample.len()) {
            self.history.push_back((sample.clone(), charge));
        }
    }

    /// What a reader that comes now gets.
    pub(crate) fn history(&self, now: Nanos) -> impl Iterator<Item = &Sample> {
        let all = self.history.iter().map(|(sample, _)| sample);
        all.filter(move |sample| !sample.is_expired(now))
    }
}
