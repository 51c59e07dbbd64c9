//! A service's server: requests from its inbox, replies now or later, from any thread.

use super::callback::{CallbackContext, CallbackResult};
use super::env::Env;
use super::handle::{Handle, Taken};
use super::state::HandleState;
use crate::Nanos;
use crate::executor::wake::lazy_now::LazyNow;
use crate::handoff::{Inbox, RequestIdentity, RingSlot};
use crate::middleware::encoding::Encoding;
use crate::middleware::remedy::SERVICE;
use crate::middleware::{Middleware, PublishError, WriterId};
use crate::sync::{Arc, Mutex};
use alloc::boxed::Box;
use core::fmt;
use core::marker::PhantomData;
use replenish_msg::{Message, Service};

/// Where replies go.
pub(crate) struct ReplyLine {
    pub(crate) middleware: Arc<dyn Middleware>,
    pub(crate) writer: WriterId,
    pub(crate) buffer: Mutex<Box<[u8]>>,
}

impl ReplyLine {
    fn send<M: Message>(&self, to: &RequestIdentity, reply: &M) -> Result<(), PublishError> {
        let mut buffer = self.buffer.lock();
        let encoding = Encoding::of::<M>(SERVICE);
        let encoded = replenish_msg::encode(reply, &mut buffer);
        let len = encoded.map_err(|e| encoding.failed(e, &buffer))?;
        let payload = buffer.get(..len).unwrap_or_default();
        self.middleware.reply(self.writer, to, payload)
    }
}

impl Drop for ReplyLine {
    fn drop(&mut self) {
        self.middleware.delete_writer(self.writer);
    }
}

/// The right to answer one request, once: in the callback, or later from any thread.
///
/// Dropping it leaves the request unanswered; the client then runs into its timeout.
#[must_use = "dropping it leaves the request unanswered"]
pub struct Responder<S> {
    line: Arc<ReplyLine>,
    to: RequestIdentity,
    service: PhantomData<fn(&S)>,
}

impl<S: Service> Responder<S> {
    /// Which request this is.
    #[must_use]
    pub fn request(&self) -> RequestIdentity {
        self.to
    }

    /// Sends the answer. Does not allocate and never waits for a peer.
    ///
    /// # Errors
    /// When it was not sent: the client is gone, no room, too large.
    pub fn reply(self, response: &S::Response) -> Result<(), PublishError> {
        self.line.send(&self.to, response)
    }

    /// Sends an answer that is encoded already. May be tried again.
    pub(crate) fn reply_bytes(&self, payload: &[u8]) -> Result<(), PublishError> {
        self.line
            .middleware
            .reply(self.line.writer, &self.to, payload)
    }
}

impl<S> fmt::Debug for Responder<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Responder")
            .field("to", &self.to)
            .finish_non_exhaustive()
    }
}

pub(crate) struct Server<S: Service, F> {
    shared: Arc<HandleState>,
    inbox: Arc<Inbox>,
    line: Arc<ReplyLine>,
    request: S::Request,
    /// The request taken last, as it came.
    read_slot: Option<RingSlot>,
    callback: F,
}

impl<S: Service, F> Server<S, F> {
    pub(crate) fn new(
        shared: Arc<HandleState>,
        (inbox, max_request): (Arc<Inbox>, usize),
        line: ReplyLine,
        callback: F,
    ) -> Self {
        let mut request = S::Request::default();
        request.reserve(max_request);
        Self {
            shared,
            inbox,
            line: Arc::new(line),
            request,
            read_slot: None,
            callback,
        }
    }
}

impl<S, F, R> Handle for Server<S, F>
where
    S: Service,
    F: FnMut(&S::Request, Responder<S>, &CallbackContext<'_>) -> R + Send,
    R: CallbackResult,
{
    fn is_ready(&mut self, _now: &LazyNow) -> bool {
        self.inbox.waiting() > 0
    }

    fn take(&mut self, env: &Env<'_>) -> Option<Taken> {
        self.shared
            .take_sample(&self.inbox, &mut self.read_slot, &mut self.request, env)
    }

    fn execute(&mut self, env: &Env<'_>, started: Nanos) {
        let Some(info) = self.read_slot.as_ref().map(RingSlot::info) else {
            return;
        };
        let cx = CallbackContext::about(&info, env, &self.shared, started);
        let responder = Responder {
            line: Arc::clone(&self.line),
            to: info.request,
            service: PhantomData,
        };
        let result = (self.callback)(&self.request, responder, &cx);
        result.inspect(&mut |e| self.shared.failed(e, env.events));
    }
}
