//! The state of a handle that other threads see: counters, inbox, marks of its removal.

use super::departure::Departure;
use crate::event::{Event, Events};
use crate::executor::wake::doorbell::WakeHandle;
use crate::handoff::Inbox;
use crate::histogram::LiveHistogram;
use crate::middleware::{Middleware, ReaderId};
use crate::platform::{FULL, Late, ShortText, recorder};
use crate::stats::{Counters, HandleStats};
use crate::sync::{Arc, AtomicBool, Mutex, Once, Ordering};
use alloc::string::String;
use core::fmt;
use replenish_msg::DecodeError;

/// A handle's own hook for what goes wrong with it.
pub(crate) type ErrorHook = Arc<Events>;

/// A handle's state outside its worker. The fields that each message needs come first, in one line
/// of the cache: a core that has slept fetches each line from afar.
#[repr(C)]
#[cfg_attr(feature = "std", repr(align(64)))]
pub(crate) struct HandleState {
    /// No callback of it starts any more.
    pub(crate) removed: AtomicBool,
    /// A callback of it that runs shall end.
    pub(crate) cancelled: AtomicBool,
    /// In recordings.
    pub(crate) name: recorder::NameId,
    /// The reader of a subscription, service or client, and its inbox.
    pub(crate) input: Option<(ReaderId, Arc<Inbox>)>,
    pub(crate) counters: Counters,
    /// Times from release to start.
    pub(crate) latency: LiveHistogram,
    /// Times from release to end.
    pub(crate) response: LiveHistogram,
    pub(crate) id: String,
    pub(crate) last_error: Mutex<ShortText>,
    pub(crate) hook: Once<ErrorHook>,
    /// The way to the worker, for publishers of this process.
    pub(super) wake: Late<WakeHandle>,
    #[allow(
        dead_code,
        reason = "handles of builds without feature `full` never leave"
    )]
    pub(crate) departure: Departure,
}

impl HandleState {
    pub(crate) fn new(id: String, input: Option<(ReaderId, Arc<Inbox>)>) -> Arc<Self> {
        Arc::new(Self {
            name: recorder::handle(&id),
            id,
            counters: Counters::default(),
            latency: LiveHistogram::default(),
            response: LiveHistogram::default(),
            last_error: Mutex::new(ShortText::EMPTY),
            input,
            hook: Once::new(),
            wake: Late::new(),
            removed: AtomicBool::new(false),
            cancelled: AtomicBool::new(false),
            departure: Departure::new(),
        })
    }

    pub(crate) fn is_removed(&self) -> bool {
        self.removed.load(Ordering::Acquire)
    }

    /// Reports the `count`-th failure of this handle: each one to its hook, and rarely to the
    /// events.
    pub(crate) fn report(&self, count: u64, event: &Event<'_>, events: &Events) {
        if let Some(hook) = self.hook.get() {
            hook.emit(event);
        }
        events.emit_rarely(count, event);
    }

    /// A callback returned an error.
    pub(crate) fn failed(&self, error: &dyn fmt::Display, events: &Events) {
        let count = self.counters.errors.add(1);
        *self.last_error.lock() = ShortText::of(error);
        let handle = &self.id;
        let event = Event::CallbackFailed {
            handle,
            error,
            count,
        };
        self.report(count, &event, events);
    }

    /// A sample could not be decoded.
    pub(crate) fn undecodable(&self, error: DecodeError, events: &Events) {
        let count = self.counters.undecodable.add(1);
        let handle = &self.id;
        let event = Event::Undecodable {
            handle,
            error,
            count,
        };
        self.report(count, &event, events);
    }

    /// Discards waiting samples, and with `close` all later ones. Returns the number discarded.
    pub(crate) fn discard(&self, close: bool, middleware: &dyn Middleware) -> u64 {
        let Some((_, inbox)) = &self.input else {
            return 0;
        };
        let (discarded, wake) = if close { inbox.close() } else { inbox.clear() };
        let discarded = discarded as u64;
        self.counters.discarded.add(discarded);
        if wake {
            middleware.wake();
        }
        discarded
    }

    /// The counters at this moment.
    pub(crate) fn stats(&self, middleware: &dyn Middleware) -> HandleStats {
        let reader = self.input.as_ref();
        let lost = reader.map_or(0, |(reader, _)| middleware.lost(*reader));
        self.counters.snapshot(self.waiting(), lost)
    }

    /// Bytes that were taken for its samples, here and in the middleware.
    pub(crate) fn memory(&self, middleware: &dyn Middleware) -> usize {
        let input = self.input.as_ref();
        input.map_or(0, |(reader, inbox)| {
            inbox.memory().saturating_add(middleware.memory(*reader))
        })
    }

    /// The writers that its reader hears, as far as the middleware knows.
    pub(crate) fn matched(&self, middleware: &dyn Middleware) -> Option<usize> {
        let (reader, _) = self.input.as_ref().filter(|_| FULL)?;
        middleware.matched_writers(*reader)
    }

    /// Samples that wait for the worker.
    fn waiting(&self) -> u64 {
        self.input
            .as_ref()
            .map_or(0, |(_, inbox)| inbox.waiting() as u64)
    }
}
