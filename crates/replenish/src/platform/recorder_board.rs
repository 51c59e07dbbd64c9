//! In the place of `std/recorder` in builds without feature `std`: events go to the board's ring,
//! which is there with feature `recorder` of `replenish-os`; without it they go nowhere.
#![expect(
    clippy::unnecessary_wraps,
    clippy::missing_const_for_fn,
    reason = "the signatures of what it stands in for"
)]

use crate::Nanos;
use crate::platform::Text;
use replenish_os::recorder::{self, Kind, Name, NameKind, Slot};
use replenish_os::{Account, Usage};

/// The id of a name in events; 0 for names beyond the 32 that a board has room for.
pub(crate) type NameId = Name;

/// The program's own point in the recording, named when the program sets itself up.
#[derive(Debug, Clone, Copy)]
pub struct Mark(Name);

impl Mark {
    /// A mark of this name, of which a board keeps the first 40 bytes. Set-up only.
    #[must_use]
    pub fn new(name: &str) -> Self {
        Self(Name::of(NameKind::Mark, name))
    }
}

/// A board has no files.
#[derive(Debug, Clone)]
pub struct Dump(());

/// The requested recording; a board's ring has its size.
#[derive(Debug, Clone, Default)]
pub(crate) struct Settings {
    pub(crate) bytes: usize,
    #[allow(dead_code, reason = "nobody reads it")]
    pub(crate) dump: Option<Dump>,
}

/// A thread that is to start.
#[allow(dead_code, reason = "read where there is a ring")]
pub(crate) struct ThreadFacts<'a> {
    pub(crate) slot: &'a ThreadSlot,
    pub(crate) name: &'a str,
    pub(crate) dispatches: bool,
    pub(crate) cpu: Option<usize>,
    pub(crate) budget: Option<(u64, u64)>,
}

/// No chain is measured.
pub(crate) struct ChainFacts;

/// A thread's place in the ring.
#[derive(Debug, Default)]
pub(crate) struct ThreadSlot(Slot);

impl ThreadSlot {
    pub(crate) fn install(&self, account: &Account, granted: &str) {
        account.record_as(recorder::install(&self.0, granted));
    }
}

/// The ring is the image's, and stays.
#[derive(Debug, Default)]
pub(crate) struct Recording {
    pub(crate) fallback: Option<Text>,
}

impl Recording {
    pub(crate) fn start<'a>(
        _: &Settings,
        threads: impl Iterator<Item = ThreadFacts<'a>>,
        _: &[ChainFacts],
    ) -> Result<Self, Text> {
        if recorder::ON {
            recorder::restart();
            for thread in threads {
                let ThreadFacts {
                    slot,
                    name,
                    dispatches,
                    budget,
                    ..
                } = thread;
                recorder::lay(&slot.0, name, dispatches, budget);
            }
        }
        Ok(Self::default())
    }

    pub(crate) fn end(&mut self) {}
}

pub(crate) fn handle(id: &str) -> NameId {
    Name::of(NameKind::Handle, id)
}

pub(crate) fn topic(name: &str) -> NameId {
    Name::of(NameKind::Topic, name)
}

pub(crate) fn take(handle: NameId, arrival: Nanos, bytes: usize) {
    recorder::event(Kind::Take, handle, arrival, [bytes as u64, 0]);
}

pub(crate) fn dropped(handle: NameId, arrival: Nanos, bytes: usize) {
    recorder::event(Kind::Drop, handle, arrival, [bytes as u64, 0]);
}

pub(crate) fn wake(since: Nanos, awake: Nanos) {
    recorder::event(Kind::Wake, Name::NONE, since, [awake, 0]);
}

pub(crate) fn block() {
    recorder::event_now(Kind::Block, Name::NONE, [0, 0]);
}

pub(crate) fn begin(handle: NameId, started: Nanos, due: Nanos) {
    recorder::begin(handle, started, due);
}

pub(crate) fn end(time: Nanos) {
    recorder::end(time);
}

pub(crate) fn spoiled() {
    if recorder::ON {
        recorder::end(replenish_os::clock::monotonic());
    }
}

pub(crate) fn panicked(handle: NameId) {
    recorder::event_now(Kind::Panic, handle, [0, 0]);
    spoiled();
}

pub(crate) fn miss(handle: NameId, time: Nanos, lateness: Nanos, deadline: Nanos) {
    recorder::event(Kind::Miss, handle, time, [lateness, deadline]);
}

pub(crate) fn skip(handle: NameId, count: u64) {
    recorder::event_now(Kind::Skip, handle, [count, 0]);
}

pub(crate) fn publish(topic: NameId, bytes: usize, refused: bool) {
    recorder::event_now(Kind::Publish, topic, [bytes as u64, refused.into()]);
}

pub(crate) fn mark(mark: Mark, value: u64) {
    recorder::event_now(Kind::Mark, mark.0, [value, 0]);
}

/// Readings of CPU clocks would fill a small ring.
pub(crate) fn used(_: &Usage) {}

pub(crate) fn queue(handle: NameId, time: Nanos, _holder: Option<NameId>) {
    recorder::event(Kind::Queue, handle, time, [0, 0]);
}
