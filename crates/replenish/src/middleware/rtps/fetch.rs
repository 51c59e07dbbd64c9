//! Memory of other publishers: opened as they are matched, and long samples fetched from it.

use super::adapter::Rtps;
use super::shared::OPEN;
use super::state::State;
use crate::sync::Arc;
use replenish_os::{Fetched, PiMutex, PiMutexGuard, SegmentReader, clock};
use replenish_rtps::participant as rtps;
use replenish_rtps::wire::SharedPlace;

impl Rtps {
    /// Opens the memory of publishers that were matched, and closes that of those that have gone.
    ///
    /// Discovery alone comes here: opening maps the memory and allocates.
    #[cold]
    pub(super) fn look_after_segments(&self) {
        loop {
            let mut state = self.state.lock();
            let State {
                segments,
                participant,
                ..
            } = &mut *state;
            segments.has_changed = false;
            let mut open = segments.open.iter();
            let parted = open.position(|(writer, _)| !participant.has_reader_of(*writer));
            if let Some(at) = parted {
                let closed = segments.open.swap_remove(at);
                drop(state);
                drop(closed); // unmapped without the lock
                continue;
            }
            let Some((writer, name)) = participant.wanted_segment() else {
                return;
            };
            let is_open = segments.of(writer).is_some();
            let has_room = segments.open.len() < OPEN;
            drop(state);
            let opened = (!is_open && has_room).then(|| SegmentReader::open(name.0));
            let opened = opened.and_then(Result::ok);
            let mut state = self.state.lock();
            let is_open = is_open || opened.is_some();
            if let Some(memory) = opened {
                state.segments.open.push((writer, Arc::new(memory)));
            }
            state.participant.segment_opened(writer, is_open);
        }
    }
}

impl State {
    /// Copies samples to which references have come, each without the lock: those of `only`, or of
    /// all readers.
    pub(super) fn fetch_all<'m>(
        lock: &'m PiMutex<Self>,
        mut state: PiMutexGuard<'m, Self>,
        only: Option<rtps::ReaderId>,
    ) -> PiMutexGuard<'m, Self> {
        while let Some(mut fetch) = state.participant.fetch(only) {
            let memory = state.segments.of(fetch.writer).map(Arc::clone);
            drop(state);
            let SharedPlace { slot, stamp } = fetch.place;
            let read = |memory: Arc<SegmentReader>| memory.read(slot, stamp, fetch.room());
            let fetched = memory.map_or(Fetched::Broken, read);
            let now = clock::monotonic();
            state = lock.lock();
            let whole = fetched == Fetched::Whole;
            state.stats.shared += u64::from(whole);
            let broken = fetched == Fetched::Broken;
            state.participant.fetched(fetch, whole, broken, now);
        }
        state
    }
}
