//! A subscription: bytes from its inbox, decoded in place on the worker, handed to the callback.

use super::callback::{CallbackContext, CallbackResult};
use super::handle::{Env, Handle, Shared};
use crate::Nanos;
use crate::event::Event;
use crate::handoff::Inbox;
use crate::qos::IngressLimit;
use crate::sync::Arc;
use replenish_msg::Message;
use replenish_os::clock;

/// A topic as a subscription asks for it: its name, and possibly a bound on the sample size.
///
/// ```
/// use replenish::Topic;
/// let small = Topic::named("text").max_size(64);
/// let usual: Topic = "text".into();
/// # let _ = (small, usual);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Topic<'a> {
    pub(crate) name: &'a str,
    pub(crate) max_size: Option<usize>,
    pub(crate) ingress: IngressLimit,
}

impl<'a> Topic<'a> {
    /// The topic of this name, expanded against the node's name.
    #[must_use]
    pub const fn named(name: &'a str) -> Self {
        Self {
            name,
            max_size: None,
            ingress: IngressLimit::none(),
        }
    }

    /// Slots of this many bytes instead of [`Message::MAX_SIZE`]. Larger samples are dropped,
    /// counted and reported. 1 ≤ `bytes` ≤ `MAX_SIZE`.
    #[must_use]
    pub const fn max_size(self, bytes: usize) -> Self {
        Self {
            max_size: Some(bytes),
            ..self
        }
    }

    /// What the peer may send, so that a flood is stopped before it reaches this machine.
    #[must_use]
    pub const fn ingress_limit(self, limit: IngressLimit) -> Self {
        Self {
            ingress: limit,
            ..self
        }
    }
}

impl<'a> From<&'a str> for Topic<'a> {
    fn from(name: &'a str) -> Self {
        Self::named(name)
    }
}

pub(crate) struct Subscription<M, F> {
    shared: Arc<Shared>,
    inbox: Arc<Inbox>,
    message: M,
    callback: F,
}

impl<M: Message, F> Subscription<M, F> {
    pub(crate) fn new(shared: Arc<Shared>, inbox: Arc<Inbox>, callback: F) -> Self {
        Self {
            shared,
            inbox,
            message: M::default(),
            callback,
        }
    }
}

impl<M, F, R> Handle for Subscription<M, F>
where
    M: Message,
    F: FnMut(&M, &CallbackContext<'_>) -> R + Send,
    R: CallbackResult,
{
    fn begin(&mut self, _start: Nanos) {}

    fn is_ready(&self, _now: Nanos) -> bool {
        self.inbox.waiting() > 0
    }

    fn next_release(&self) -> Option<Nanos> {
        None
    }

    fn run(&mut self, env: &Env<'_>) {
        let Some(popped) = self.inbox.pop() else {
            return;
        };
        if popped.wake {
            env.stop.middleware.wake();
        }
        let arrival = popped.slot.arrival();
        let decoded = replenish_msg::decode(&mut self.message, popped.slot.payload());
        self.inbox.give_back(popped.slot);
        let shared = &self.shared;
        if let Err(error) = decoded {
            let count = shared.counters.undecodable.add(1);
            let handle = &shared.id;
            let event = Event::Undecodable {
                handle,
                error,
                count,
            };
            return env.events.emit_rarely(count, &event);
        }
        let started = clock::monotonic();
        let latency = started.saturating_sub(arrival);
        shared.counters.worst_latency.raise(latency);
        let cx = CallbackContext {
            id: &shared.id,
            worker: env.worker,
            due: arrival,
            started,
            skipped: 0,
            stop: env.stop,
        };
        let result = (self.callback)(&self.message, &cx);
        result.inspect(&mut |e| shared.failed(e, env.events));
        shared.counters.executed.add(1);
    }
}
