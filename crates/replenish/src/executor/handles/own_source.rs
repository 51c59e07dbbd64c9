//! [`OwnSource`]: a subscription whose worker takes its samples from the middleware itself.
//!
//! ```text
//!                 heard: its descriptor is readable
//!   known empty ─────────────────────────────────► to be pulled ──┐ pull: there may be more
//!        ▲                                             ▲  │       │
//!        └─────────────────────────────────────────────┼──┘ ◄─────┘
//!                     pull: nothing is left            └── before each round that looks at all
//! ```
//!
//! The worker pulls before it looks at the handle, so that the work is done on its priority and on
//! its budget, however much comes.

use super::filler::Filler;
use super::state::HandleState;
use crate::event::Events;
use crate::handoff::Keep;
use crate::middleware::{Middleware, Source, SourceSet};
use crate::sync::Arc;
use alloc::boxed::Box;

/// The way of a subscription's samples past the dispatcher.
pub(crate) struct OwnSource {
    set: Arc<SourceSet>,
    source: Box<dyn Source>,
    filler: Filler,
    key: u32,
    /// Its worker listens.
    begun: bool,
    /// Nothing has come since the last pull.
    is_empty: bool,
}

impl OwnSource {
    /// The samples of this handle, in `slot` of the worker that waits in `set`, if the middleware
    /// hands them to the worker. One that keeps all gets them from the dispatcher, which leaves
    /// them in the middleware while there is no room.
    pub(crate) fn of(
        shared: &Arc<HandleState>,
        middleware: &dyn Middleware,
        set: &Arc<SourceSet>,
        slot: usize,
    ) -> Option<Box<Self>> {
        let (reader, inbox) = shared.input.as_ref()?;
        if inbox.keep() == Keep::All {
            return None;
        }
        let key = u32::try_from(slot).ok()?;
        let source = middleware.source(*reader, set, key)?;
        Some(Box::new(Self {
            set: Arc::clone(set),
            source,
            filler: Filler::new(Arc::clone(shared)),
            key,
            begun: false,
            is_empty: false,
        }))
    }

    /// Its worker has it, and listens to it from now on. Not before: samples that nobody takes
    /// would end each wait.
    pub(crate) fn begin(&mut self) {
        self.source.begin(&self.set, self.key);
        self.set.join();
        self.begun = true;
    }

    /// Samples have come.
    pub(crate) const fn heard(&mut self) {
        self.is_empty = false;
    }

    /// Whether a pull may find samples.
    pub(crate) const fn has_more(&self) -> bool {
        !self.is_empty
    }

    /// Takes a batch of samples into the inbox, unless nothing has come.
    pub(crate) fn pull(&mut self, events: &Events) {
        if self.is_empty {
            return;
        }
        let filler = &mut self.filler;
        let more = self.source.pull(&mut |info, bytes| {
            filler.deliver(info, bytes);
        });
        self.is_empty = !more;
        if filler.has_oversize() {
            filler.report_oversize(events);
        }
    }
}

impl Drop for OwnSource {
    fn drop(&mut self) {
        if self.begun {
            self.set.leave();
        }
    }
}
