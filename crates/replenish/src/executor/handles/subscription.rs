//! A subscription: bytes from its inbox, decoded in place on the worker, handed to the callback. A
//! message that is in memory is handed over as it is.

use super::callback::{CallbackContext, CallbackResult};
use super::env::Env;
use super::handle::{Handle, Taken};
use super::state::HandleState;
use crate::Nanos;
use crate::executor::wake::doorbell::WakeHandle;
use crate::executor::wake::lazy_now::LazyNow;
use crate::handoff::{Inbox, RingSlot, Shared};
use crate::sync::Arc;
use core::marker::PhantomData;
use replenish_msg::{Message, View, Viewed};

/// Messages of one type. The callback gets `None` when it is invoked without a new one.
pub(crate) struct Subscription<M, F> {
    shared: Arc<HandleState>,
    inbox: Arc<Inbox>,
    message: M,
    /// The sample taken last, as it came.
    read_slot: Option<RingSlot>,
    callback: F,
}

impl<M: Message, F> Subscription<M, F> {
    pub(crate) fn new(shared: Arc<HandleState>, inbox: Arc<Inbox>, callback: F) -> Self {
        Self {
            shared,
            inbox,
            message: M::default(),
            read_slot: None,
            callback,
        }
    }
}

impl<M, F, R> Handle for Subscription<M, F>
where
    M: Message,
    F: FnMut(Option<&M>, &CallbackContext<'_>) -> R + Send,
    R: CallbackResult,
{
    fn begin(&mut self, _start: Nanos, wake: &WakeHandle) {
        self.shared.begin(wake);
    }

    fn is_ready(&mut self, _now: &LazyNow) -> bool {
        self.inbox.waiting() > 0
    }

    fn take(&mut self, env: &Env<'_>) -> Option<Taken> {
        self.shared
            .take_sample(&self.inbox, &mut self.read_slot, &mut self.message, env)
    }

    fn execute(&mut self, env: &Env<'_>, started: Nanos) {
        let Some(slot) = &mut self.read_slot else {
            return;
        };
        // Free for its publisher when the callback has ended, or has panicked.
        let held = slot.take_shared();
        let message = held.as_ref().and_then(Shared::get).unwrap_or(&self.message);
        let info = slot.info();
        let cx = CallbackContext::about(&info, env, &self.shared, started);
        let result = (self.callback)(Some(message), &cx);
        result.inspect(&mut |e| self.shared.failed(e, env.events));
    }

    fn execute_empty(&mut self, env: &Env<'_>, started: Nanos) {
        let cx = CallbackContext::new(env, &self.shared, started, started);
        let result = (self.callback)(None, &cx);
        result.inspect(&mut |e| self.shared.failed(e, env.events));
    }
}

/// Bytes as they came: nothing is decoded or copied, the callback reads the slot itself.
pub(crate) struct RawSubscription<F> {
    shared: Arc<HandleState>,
    inbox: Arc<Inbox>,
    read_slot: Option<RingSlot>,
    callback: F,
}

impl<F> RawSubscription<F> {
    pub(crate) fn new(shared: Arc<HandleState>, inbox: Arc<Inbox>, callback: F) -> Self {
        Self {
            shared,
            inbox,
            read_slot: None,
            callback,
        }
    }

    fn take_slot(&mut self, env: &Env<'_>) -> Option<Taken> {
        env.next_sample(&self.inbox, &mut self.read_slot, &self.shared.counters)
            .map(Taken::sample)
    }
}

impl<F, R> Handle for RawSubscription<F>
where
    F: FnMut(&[u8], &CallbackContext<'_>) -> R + Send,
    R: CallbackResult,
{
    fn is_ready(&mut self, _now: &LazyNow) -> bool {
        self.inbox.waiting() > 0
    }

    fn take(&mut self, env: &Env<'_>) -> Option<Taken> {
        self.take_slot(env)
    }

    fn execute(&mut self, env: &Env<'_>, started: Nanos) {
        let Some(slot) = &self.read_slot else {
            return;
        };
        let info = slot.info();
        let cx = CallbackContext::about(&info, env, &self.shared, started);
        let result = (self.callback)(slot.payload(), &cx);
        result.inspect(&mut |e| self.shared.failed(e, env.events));
    }
}

/// Messages as views into the bytes that came: nothing is copied, and nothing allocates.
pub(crate) struct ViewSubscription<M, F> {
    raw: RawSubscription<F>,
    /// The bytes taken last were no such message.
    spoiled: bool,
    message: PhantomData<fn() -> M>,
}

impl<M, F> ViewSubscription<M, F> {
    pub(crate) fn new(shared: Arc<HandleState>, inbox: Arc<Inbox>, callback: F) -> Self {
        Self {
            raw: RawSubscription::new(shared, inbox, callback),
            spoiled: false,
            message: PhantomData,
        }
    }
}

impl<M, F, R> Handle for ViewSubscription<M, F>
where
    M: Viewed,
    F: FnMut(&M::View<'_>, &CallbackContext<'_>) -> R + Send,
    R: CallbackResult,
{
    fn is_ready(&mut self, _now: &LazyNow) -> bool {
        self.raw.inbox.waiting() > 0
    }

    fn take(&mut self, env: &Env<'_>) -> Option<Taken> {
        self.raw.take_slot(env)
    }

    fn execute(&mut self, env: &Env<'_>, started: Nanos) {
        let raw = &mut self.raw;
        let Some(slot) = &raw.read_slot else {
            return;
        };
        match M::View::from_payload(slot.payload()) {
            Ok(view) => {
                let info = slot.info();
                let cx = CallbackContext::about(&info, env, &raw.shared, started);
                let result = (raw.callback)(&view, &cx);
                result.inspect(&mut |e| raw.shared.failed(e, env.events));
            }
            Err(error) => {
                raw.shared.undecodable(error, env.events);
                self.spoiled = true;
            }
        }
    }

    fn was_spoiled(&mut self) -> bool {
        core::mem::take(&mut self.spoiled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Events;
    use crate::executor::StopHandle;
    use crate::handoff::{Keep, SampleInfo};
    use crate::middleware::{InProcessBus, Middleware, ReaderId};
    use replenish_interfaces::std_msgs::msg;
    use replenish_os::Account;
    use std::sync::Mutex;

    /// The text that the callback sees is in the slot that the dispatcher has filled.
    #[test]
    fn a_view_is_in_the_bytes_that_came() {
        let inbox = Arc::new(Inbox::new(2, 64, Keep::Newest));
        let shared = HandleState::new("view".into(), Some((ReaderId(0), Arc::clone(&inbox))));
        let seen = Arc::new(Mutex::new(Vec::new()));
        let note = Arc::clone(&seen);
        let called = move |text: &msg::StringView<'_>, _: &CallbackContext<'_>| {
            let text = text.data.as_bytes().as_ptr_range();
            note.lock()
                .unwrap()
                .push((text.start as usize, text.end as usize));
        };
        let mut handle = ViewSubscription::<msg::String, _>::new(shared, inbox, called);
        let middleware: Arc<dyn Middleware> = Arc::new(InProcessBus::new().participant());
        let stop = StopHandle::new(Arc::clone(&middleware));
        let env = Env {
            worker: "w",
            stop: &stop,
            events: &Events::default(),
            meter: &Account::unbudgeted().meter(),
            middleware: &*middleware,
            live: None,
            outbox: None,
        };
        let mut buf = [0; 64];
        let len = msg::StringView { data: "in place" }
            .encode_to(&mut buf)
            .unwrap();
        let mut read_slot = None;
        let inbox = Arc::clone(&handle.raw.inbox);
        for n in 1..=2 {
            inbox.deliver(&mut read_slot, &buf[..len], &SampleInfo::at(0));
            assert!(handle.take(&env).is_some());
            let slot = handle
                .raw
                .read_slot
                .as_ref()
                .unwrap()
                .payload()
                .as_ptr_range();
            handle.execute(&env, 0);
            assert!(!handle.was_spoiled());
            let seen = seen.lock().unwrap();
            let (start, end) = seen[n - 1];
            assert_eq!(end - start, "in place".len());
            assert!(slot.start as usize <= start && end <= slot.end as usize);
        }
        inbox.deliver(&mut read_slot, &[9, 0, 0, 0, b'x'], &SampleInfo::at(0));
        assert!(handle.take(&env).is_some());
        handle.execute(&env, 0);
        assert!(handle.was_spoiled(), "half a text");
        assert_eq!(handle.raw.shared.counters.undecodable.get(), 1);
    }
}
