//! The state of a handle that other threads see: counters, inbox, marks of its removal.

use crate::event::{Event, Events};
use crate::executor::wake::stop::StopHandle;
use crate::handoff::Inbox;
use crate::histogram::LiveHistogram;
use crate::middleware::ReaderId;
use crate::platform::{self, ShortText};
use crate::stats::Counters;
#[cfg(feature = "full")]
use crate::sync::Notify;
use crate::sync::{Arc, AtomicBool, Mutex, Once, Ordering};
use alloc::string::String;
use core::fmt;
use replenish_msg::DecodeError;

/// A handle's own hook for what goes wrong with it.
pub(crate) type ErrorHook = Arc<dyn Fn(&Event<'_>) + Send + Sync>;

/// What is known about a handle outside its worker. What each message needs comes first, in one
/// line of the cache: a core that has slept fetches each line from afar.
#[repr(C)]
#[cfg_attr(feature = "std", repr(align(64)))]
pub(crate) struct HandleState {
    /// No callback of it starts any more.
    pub(crate) removed: AtomicBool,
    /// A callback of it that runs shall end.
    pub(crate) cancelled: AtomicBool,
    /// The reader of a subscription, service or client, and its inbox.
    pub(crate) input: Option<(ReaderId, Arc<Inbox>)>,
    pub(crate) counters: Counters,
    /// From release to start.
    pub(crate) latency: LiveHistogram,
    /// From release to end.
    pub(crate) response: LiveHistogram,
    pub(crate) id: String,
    pub(crate) last_error: Mutex<ShortText>,
    pub(crate) hook: Once<ErrorHook>,
    /// Set when the worker has let go of it.
    #[cfg(feature = "full")]
    pub(crate) gone: Notify,
    /// The dispatcher brings it nothing any more.
    #[cfg(feature = "full")]
    pub(crate) unrouted: AtomicBool,
}

impl HandleState {
    pub(crate) fn new(id: String, input: Option<(ReaderId, Arc<Inbox>)>) -> Arc<Self> {
        Arc::new(Self {
            id,
            counters: Counters::default(),
            latency: LiveHistogram::default(),
            response: LiveHistogram::default(),
            last_error: Mutex::new(ShortText::EMPTY),
            input,
            hook: Once::new(),
            removed: AtomicBool::new(false),
            cancelled: AtomicBool::new(false),
            #[cfg(feature = "full")]
            gone: Notify::new(),
            #[cfg(feature = "full")]
            unrouted: AtomicBool::new(false),
        })
    }

    pub(crate) fn is_removed(&self) -> bool {
        self.removed.load(Ordering::Acquire)
    }

    /// Something went wrong with this handle, for the `count`-th time: tells its hook each time,
    /// and everybody rarely.
    pub(crate) fn report(&self, count: u64, event: &Event<'_>, events: &Events) {
        if let Some(hook) = self.hook.get() {
            // If it panics, the panic hook has said so; the handle goes on.
            platform::guard(&mut (), |()| hook(event), |(), _| ());
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
