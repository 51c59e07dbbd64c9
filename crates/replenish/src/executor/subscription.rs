//! A subscription: bytes from its inbox, decoded in place on the worker, handed to the callback.

use super::callback::{CallbackContext, CallbackResult};
use super::handle::{Env, Handle, Shared, Taken};
use crate::Nanos;
use crate::handoff::{Inbox, SampleInfo, Slot};
use crate::sync::Arc;
use replenish_msg::Message;

/// Messages of one type. The callback gets `None` when it is invoked without a new one.
pub(crate) struct Subscription<M, F> {
    shared: Arc<Shared>,
    inbox: Arc<Inbox>,
    message: M,
    info: SampleInfo,
    callback: F,
}

impl<M: Message, F> Subscription<M, F> {
    pub(crate) fn new(shared: Arc<Shared>, inbox: Arc<Inbox>, callback: F) -> Self {
        Self {
            shared,
            inbox,
            message: M::default(),
            info: SampleInfo::at(0),
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
    fn is_ready(&mut self, _now: Nanos) -> bool {
        self.inbox.waiting() > 0
    }

    fn take(&mut self, env: &Env<'_>) -> Option<Taken> {
        self.info = self
            .shared
            .take_sample(&self.inbox, &mut self.message, env)?;
        Some(Taken {
            due: self.info.arrival,
            deadline: None,
        })
    }

    fn execute(&mut self, env: &Env<'_>, started: Nanos) {
        let due = self.info.arrival;
        let cx = CallbackContext {
            info: self.info,
            ..CallbackContext::new(env, &self.shared, due, started)
        };
        let result = (self.callback)(Some(&self.message), &cx);
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
    shared: Arc<Shared>,
    inbox: Arc<Inbox>,
    slot: Option<Slot>,
    callback: F,
}

impl<F> RawSubscription<F> {
    pub(crate) fn new(shared: Arc<Shared>, inbox: Arc<Inbox>, callback: F) -> Self {
        Self {
            shared,
            inbox,
            slot: None,
            callback,
        }
    }
}

impl<F, R> Handle for RawSubscription<F>
where
    F: FnMut(&[u8], &CallbackContext<'_>) -> R + Send,
    R: CallbackResult,
{
    fn is_ready(&mut self, _now: Nanos) -> bool {
        self.inbox.waiting() > 0
    }

    fn take(&mut self, env: &Env<'_>) -> Option<Taken> {
        let popped = self.inbox.pop()?;
        if popped.wake {
            env.stop.middleware.wake();
        }
        let due = popped.slot.info().arrival;
        if let Some(unread) = self.slot.replace(popped.slot) {
            self.inbox.give_back(unread); // taken, and then left out after a missed deadline
        }
        Some(Taken {
            due,
            deadline: None,
        })
    }

    fn execute(&mut self, env: &Env<'_>, started: Nanos) {
        let Some(slot) = self.slot.take() else {
            return;
        };
        let cx = CallbackContext {
            info: *slot.info(),
            ..CallbackContext::new(env, &self.shared, slot.info().arrival, started)
        };
        let result = (self.callback)(slot.payload(), &cx);
        result.inspect(&mut |e| self.shared.failed(e, env.events));
        self.inbox.give_back(slot);
    }
}
