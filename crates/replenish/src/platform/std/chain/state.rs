//! A chain's figures: written by the workers of its stages, read by any thread.

use crate::Nanos;
use crate::chain::{ChainInstance, ChainReport};
use crate::event::{Event, Events};
use crate::histogram::LiveHistogram;
use crate::platform::recorder;
use crate::stats::Counter;
use crate::sync::{Mutex, Ordering, unmodelled::AtomicU64};
use std::boxed::Box;
use std::string::String;
use std::vec::Vec;

/// A chain of an executor that runs.
pub(crate) struct ChainState {
    pub(super) name: String,
    /// In recordings.
    pub(super) id: recorder::NameId,
    slot: recorder::ChainSlot,
    stages: Vec<String>,
    limit: Option<Nanos>,
    bound: Option<Nanos>,
    begun: Counter,
    ended: Counter,
    exceeded: Counter,
    latency: LiveHistogram,
    /// Locked when an instance is worse than all before it.
    worst: Mutex<Option<ChainInstance>>,
    worst_latency: Counter,
    /// Origins of the newest instance by stage, for a next stage that samples; 0: none.
    newest: Box<[AtomicU64]>,
}

/// A chain's figures but for its histogram; times in nanoseconds.
pub(crate) struct Figures {
    pub(crate) limit: Option<Nanos>,
    pub(crate) bound: Option<Nanos>,
    pub(crate) ended: u64,
    pub(crate) exceeded: u64,
    pub(crate) worst: Option<Nanos>,
}

impl ChainState {
    pub(crate) fn new(
        name: String,
        stages: Vec<String>,
        limit: Option<Nanos>,
        bound: Option<Nanos>,
    ) -> Self {
        Self {
            id: recorder::chain(&name),
            slot: recorder::ChainSlot::default(),
            name,
            newest: stages.iter().map(|_| AtomicU64::new(0)).collect(),
            stages,
            limit,
            bound,
            begun: Counter::default(),
            ended: Counter::default(),
            exceeded: Counter::default(),
            latency: LiveHistogram::default(),
            worst: Mutex::new(None),
            worst_latency: Counter::default(),
        }
    }

    /// An instance has begun.
    pub(super) fn begin(&self) {
        self.begun.count(1);
        self.slot.begun();
    }

    /// Offers an instance to a next stage that samples.
    pub(super) fn offer(&self, stage: usize, origin: Nanos) {
        if let Some(newest) = self.newest.get(stage) {
            newest.store(origin, Ordering::Release);
        }
    }

    /// Takes up the newest instance of a stage, once.
    pub(super) fn take_up(&self, stage: usize) -> Option<Nanos> {
        let newest = self.newest.get(stage)?;
        Some(newest.swap(0, Ordering::AcqRel)).filter(|origin| *origin != 0)
    }

    /// The last stage of an instance has ended.
    pub(super) fn end(&self, origin: Nanos, end: Nanos, events: &Events) {
        let latency = end.saturating_sub(origin);
        let bucket = self.latency.record(latency);
        self.slot.ended(latency, bucket);
        recorder::chain_end(self.id, end, origin, latency);
        if self.ended.add(1) == 1 || latency > self.worst_latency.get() {
            self.worst_latency.raise(latency);
            let mut worst = self.worst.lock();
            // Another thread may have been quicker.
            if worst.is_none_or(|known| latency > known.latency) {
                *worst = Some(ChainInstance { origin, latency });
                self.slot.worst(origin, latency);
            }
        }
        if let Some(limit) = self.limit.filter(|limit| latency > *limit) {
            self.exceed(latency, limit, events);
        }
    }

    #[cold]
    fn exceed(&self, latency: Nanos, limit: Nanos, events: &Events) {
        let count = self.exceeded.add(1);
        self.slot.exceeded();
        let event = Event::ChainExceeded {
            chain: &self.name,
            latency,
            limit,
            count,
        };
        events.emit_rarely(count, &event);
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// The figures so far. Does not allocate.
    pub(crate) fn figures(&self) -> Figures {
        let ended = self.ended.get();
        Figures {
            limit: self.limit,
            bound: self.bound,
            ended,
            exceeded: self.exceeded.get(),
            worst: (ended > 0).then(|| self.worst_latency.get()),
        }
    }

    /// For the recording.
    pub(crate) fn facts(&self) -> recorder::ChainFacts<'_> {
        recorder::ChainFacts {
            slot: &self.slot,
            name: &self.name,
            id: self.id,
            limit: self.limit,
            bound: self.bound,
        }
    }

    pub(crate) fn report(&self) -> ChainReport {
        ChainReport {
            name: self.name.clone(),
            stages: self.stages.clone(),
            limit: self.limit,
            bound: self.bound,
            begun: self.begun.get(),
            ended: self.ended.get(),
            exceeded: self.exceeded.get(),
            latency: self.latency.snapshot(),
            worst: *self.worst.lock(),
        }
    }
}
