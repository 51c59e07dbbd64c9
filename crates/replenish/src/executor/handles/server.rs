//! A service's server: decodes requests from its inbox and calls the callback with the right to
//! answer.

use super::callback::{CallbackContext, CallbackResult};
use super::env::Env;
use super::handle::{Handle, Taken};
use super::state::HandleState;
use crate::Nanos;
use crate::executor::wake::lazy_now::LazyNow;
use crate::handoff::{Inbox, RingSlot};
use crate::service::responder::{ReplyWriter, Responder};
use crate::sync::Arc;
use replenish_msg::{Message, Service};

pub(crate) struct Server<S: Service, F> {
    shared: Arc<HandleState>,
    inbox: Arc<Inbox>,
    writer: Arc<ReplyWriter>,
    request: S::Request,
    /// The request taken last, as it came.
    read_slot: Option<RingSlot>,
    callback: F,
}

impl<S: Service, F> Server<S, F> {
    pub(crate) fn new(
        shared: Arc<HandleState>,
        (inbox, max_request): (Arc<Inbox>, usize),
        writer: ReplyWriter,
        callback: F,
    ) -> Self {
        let mut request = S::Request::default();
        request.reserve(max_request);
        Self {
            shared,
            inbox,
            writer: Arc::new(writer),
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
        let responder = Responder::new(&self.writer, info.request);
        let result = (self.callback)(&self.request, responder, &cx);
        result.inspect(&mut |e| self.shared.failed(e, env.events));
    }
}
