//! The callback for a client's replies: one call for each request, with its reply or with the
//! reason why there is none.

use super::callback::{CallbackContext, CallbackResult};
use super::env::Env;
use super::handle::{Handle, Taken};
use super::state::HandleState;
use crate::Nanos;
use crate::executor::wake::doorbell::WakeHandle;
use crate::executor::wake::lazy_now::LazyNow;
use crate::executor::wake::run_queue::RunQueue;
use crate::handoff::{RequestIdentity, RingSlot, SampleInfo};
use crate::middleware::encoding::decode;
use crate::platform::chain::Provenance;
use crate::service::client::ClientInner;
use crate::service::error::NoReply;
use crate::sync::{Arc, Ordering, fence};
use replenish_msg::{CdrReader, Service};
use replenish_os::clock;

pub(crate) struct Replies<S: Service, F> {
    shared: Arc<HandleState>,
    client: Arc<ClientInner>,
    response: S::Response,
    /// The reply taken last, as it came.
    read_slot: Option<RingSlot>,
    info: SampleInfo,
    /// The reason why the request has no response.
    missing: Option<NoReply>,
    callback: F,
}

impl<S: Service, F> Replies<S, F> {
    pub(crate) fn new(shared: Arc<HandleState>, client: Arc<ClientInner>, callback: F) -> Self {
        Self {
            shared,
            client,
            response: S::Response::default(),
            read_slot: None,
            info: SampleInfo::at(0),
            missing: None,
            callback,
        }
    }

    /// The next request whose limit has passed.
    fn expire(&mut self) -> Option<Taken> {
        let (number, end) = self.client.expire(clock::monotonic())?;
        self.shared.counters.received.add(1);
        self.missing = Some(NoReply::TimedOut);
        self.info = SampleInfo {
            request: RequestIdentity::reply(number),
            ..SampleInfo::at(end)
        };
        Some(Taken {
            due: end,
            deadline: None,
            provenance: Provenance::default(),
        })
    }
}

/// The executor has dropped the handle, or the handle never ran.
impl<S: Service, F> Drop for Replies<S, F> {
    fn drop(&mut self) {
        self.client.inbox.close();
    }
}

impl<S, F, R> Handle for Replies<S, F>
where
    S: Service,
    F: FnMut(Result<&mut S::Response, NoReply>, &CallbackContext<'_>) -> R + Send,
    R: CallbackResult,
{
    fn begin(&mut self, _start: Nanos, wake: &WakeHandle) {
        self.client.wake.set(wake.clone()).ok();
        fence(Ordering::SeqCst);
    }

    fn is_ready(&mut self, now: &LazyNow) -> bool {
        let expires = |end| end <= now.get();
        self.client.inbox.waiting() > 0 || self.client.earliest().is_some_and(expires)
    }

    fn next_release(&mut self) -> Option<Nanos> {
        self.client.earliest()
    }

    fn note_release(&mut self, position: usize, run_queue: &mut RunQueue) {
        let release = self.next_release();
        run_queue.next_release_of(position, release);
    }

    fn take(&mut self, env: &Env<'_>) -> Option<Taken> {
        if self.client.is_behind() {
            return None;
        }
        let Some(slot) = env.next_sample(
            &self.client.inbox,
            &mut self.read_slot,
            &self.shared.counters,
        ) else {
            return self.expire();
        };
        self.info = *slot.info();
        self.missing = None;
        let number = self.info.request.number();
        let expected = self.client.settle(number);
        let decoded = decode(&mut self.response, &CdrReader::new(slot.payload()));
        if !expected {
            self.shared.counters.discarded.add(1);
            return None;
        }
        if let Err(error) = decoded {
            self.shared.undecodable(error, env.events);
            self.shared.counters.received.add(1); // the sample, and that there is no reply
            self.missing = Some(NoReply::Undecodable(error));
        }
        Some(Taken {
            due: self.info.arrival,
            deadline: None,
            provenance: Provenance::of(&self.info),
        })
    }

    fn is_awaited(&self) -> bool {
        true
    }

    fn execute(&mut self, env: &Env<'_>, started: Nanos) {
        let cx = CallbackContext::about(&self.info, env, &self.shared, started);
        let reply = match self.missing {
            Some(why) => Err(why),
            None => Ok(&mut self.response),
        };
        let result = (self.callback)(reply, &cx);
        result.inspect(&mut |e| self.shared.failed(e, env.events));
    }
}
