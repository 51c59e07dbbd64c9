//! What a worker knows of a handle, whatever its kind; and what is shared about it.

use super::entry::HandleEntry;
use super::group::Group;
use super::outbox::Outbox;
use crate::Nanos;
use crate::event::{Event, Events};
use crate::executor::change::live::Live;
use crate::executor::wake::doorbell::WakeHandle;
use crate::executor::wake::lazy_now::LazyNow;
use crate::executor::wake::run_queue::RunQueue;
use crate::executor::wake::stop::StopHandle;
use crate::handoff::{Inbox, RingSlot};
use crate::histogram::LiveHistogram;
use crate::middleware::ReaderId;
use crate::middleware::encoding::decode;
use crate::platform::{self, ShortText};
use crate::stats::Counters;
#[cfg(feature = "full")]
use crate::sync::Notify;
use crate::sync::{Arc, AtomicBool, Mutex, Once, Ordering};
use alloc::string::String;
use core::cell::RefCell;
use core::fmt;
use replenish_msg::{CdrReader, DecodeError, Message};
use replenish_os::Meter;

/// What callbacks run in.
pub(crate) struct Env<'a> {
    pub(crate) worker: &'a str,
    pub(crate) stop: &'a StopHandle,
    pub(crate) events: &'a Events,
    pub(crate) meter: &'a Meter,
    /// The executor, if handles can be added to it.
    #[cfg_attr(not(feature = "full"), expect(dead_code, reason = "none can"))]
    pub(crate) live: Option<&'a Arc<Live>>,
    /// Where publications wait for the end of the round.
    pub(crate) outbox: Option<&'a RefCell<Outbox>>,
}

impl Env<'_> {
    /// The next sample that waits, for the one in `read_slot`.
    pub(crate) fn next_sample<'h>(
        &self,
        inbox: &Inbox,
        read_slot: &'h mut Option<RingSlot>,
    ) -> Option<&'h RingSlot> {
        if inbox.pop(read_slot)? {
            self.stop.middleware.wake();
        }
        read_slot.as_ref()
    }
}

/// Input that waits for its callback.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Taken {
    /// When it was released: the sample's arrival, the timer's release.
    pub(crate) due: Nanos,
    /// How long after that the callback should have ended, if the handle's kind says so.
    pub(crate) deadline: Option<Deadline>,
}

/// How long after its release a callback should have ended.
#[derive(Clone, Copy)]
pub(crate) struct Deadline {
    pub(crate) within: Nanos,
    /// How it is judged: found here, so that programs without deadlines do not carry the code.
    pub(crate) judge: Judge,
}

/// With the release and the deadline, and the time from that release to the end of the callback.
type Judge = fn(&mut HandleEntry, &Env<'_>, (Nanos, Nanos), Nanos);

impl Deadline {
    pub(crate) fn of(within: Nanos) -> Self {
        let judge = HandleEntry::judge;
        Self { within, judge }
    }
}

impl fmt::Debug for Deadline {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.within.fmt(f)
    }
}

impl Taken {
    pub(crate) fn sample(slot: &RingSlot) -> Self {
        Self {
            due: slot.info().arrival,
            deadline: None,
        }
    }
}

/// One callback of a worker and what triggers it. Lives on the worker's thread.
///
/// ```text
///   is_ready? ──► take: one sample or release ──► execute: the callback, with what was taken
/// ```
pub(crate) trait Handle: Send {
    /// The executor starts now; `wake` leads to it.
    fn begin(&mut self, _start: Nanos, _wake: &WakeHandle) {}
    /// Whether there is something to take.
    fn is_ready(&mut self, now: &LazyNow) -> bool;
    /// When it will have something to take by itself.
    fn next_release(&mut self) -> Option<Nanos> {
        None
    }
    /// Writes down its [next release](Self::next_release), if it has releases at all; it is at this
    /// position.
    fn note_release(&mut self, _position: usize, _agenda: &mut RunQueue) {}
    /// Takes one input, if there (still) is one and it can be used.
    fn take(&mut self, env: &Env<'_>) -> Option<Taken>;
    /// Runs the callback with what was taken last.
    fn execute(&mut self, env: &Env<'_>, started: Nanos);
    /// Whether what was taken last turned out to be unusable, and the callback did not run.
    fn was_spoiled(&mut self) -> bool {
        false
    }
    /// Runs the callback without input, if it takes that.
    fn execute_empty(&mut self, _env: &Env<'_>, _started: Nanos) {}
}

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
    pub(crate) group: Once<Group>,
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
            group: Once::new(),
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

    /// Takes the next sample of its inbox into `read_slot` and decodes it in place; one that cannot be
    /// decoded is reported and counted.
    pub(crate) fn take_sample<M: Message>(
        &self,
        inbox: &Inbox,
        read_slot: &mut Option<RingSlot>,
        message: &mut M,
        env: &Env<'_>,
    ) -> Option<Taken> {
        let slot = env.next_sample(inbox, read_slot)?;
        match decode(message, &CdrReader::new(slot.payload())) {
            Ok(()) => Some(Taken::sample(slot)),
            Err(error) => {
                self.undecodable(error, env.events);
                None
            }
        }
    }

    /// Samples that wait for the worker.
    pub(crate) fn waiting(&self) -> u64 {
        self.input
            .as_ref()
            .map_or(0, |(_, inbox)| inbox.waiting() as u64)
    }
}
