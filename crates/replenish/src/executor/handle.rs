//! What a worker knows of a handle, whatever its kind; and what is shared about it.

use super::stop::StopHandle;
use crate::Nanos;
use crate::event::{Event, Events};
use crate::handoff::Inbox;
use crate::middleware::ReaderId;
use crate::stats::{Counters, Text};
use crate::sync::{Arc, Mutex};
use alloc::string::String;
use core::fmt;

/// What callbacks run in.
pub(crate) struct Env<'a> {
    pub(crate) worker: &'a str,
    pub(crate) stop: &'a StopHandle,
    pub(crate) events: &'a Events,
}

/// One callback of a worker and what triggers it. Lives on the worker's thread.
pub(crate) trait Handle: Send {
    /// The executor starts now.
    fn begin(&mut self, start: Nanos);
    /// Whether the callback has something to do.
    fn is_ready(&self, now: Nanos) -> bool;
    /// When it will have something to do by itself.
    fn next_release(&self) -> Option<Nanos>;
    /// Runs the callback once, if it (still) has something to do.
    fn run(&mut self, env: &Env<'_>);
}

/// What is known about a handle outside its worker.
pub(crate) struct Shared {
    pub(crate) id: String,
    pub(crate) counters: Counters,
    pub(crate) last_error: Mutex<Text>,
    /// A subscription's reader and inbox.
    pub(crate) input: Option<(ReaderId, Arc<Inbox>)>,
}

impl Shared {
    pub(crate) fn new(id: String, input: Option<(ReaderId, Arc<Inbox>)>) -> Arc<Self> {
        Arc::new(Self {
            id,
            counters: Counters::default(),
            last_error: Mutex::new(Text::EMPTY),
            input,
        })
    }

    /// A callback returned an error.
    pub(crate) fn failed(&self, error: &dyn fmt::Display, events: &Events) {
        let count = self.counters.errors.add(1);
        *self.last_error.lock() = Text::of(error);
        let handle = &self.id;
        events.emit_rarely(
            count,
            &Event::CallbackFailed {
                handle,
                error,
                count,
            },
        );
    }

    /// Discards what waits, and with `close` everything that will come. Returns how many samples.
    pub(crate) fn discard(&self, close: bool, stop: &StopHandle) -> u64 {
        let Some((_, inbox)) = &self.input else {
            return 0;
        };
        let (discarded, wake) = if close { inbox.close() } else { inbox.clear() };
        let discarded = discarded as u64;
        self.counters.discarded.add(discarded);
        if wake {
            stop.middleware.wake();
        }
        discarded
    }

    /// Samples that wait for the worker.
    pub(crate) fn waiting(&self) -> u64 {
        self.input
            .as_ref()
            .map_or(0, |(_, inbox)| inbox.waiting() as u64)
    }
}
