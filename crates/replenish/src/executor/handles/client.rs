//! A service's client: requests from any thread, each with a number and a time limit; replies and
//! expired limits as callbacks of one worker.
//!
//! ```text
//!   call: lock the table ── send ── note number and limit ── unlock ── ring, if it is the earliest
//!   worker: reply ──► in the table? forget it, callback(reply) : too late, discarded
//!           limit passed ──► forget it, callback(timeout)
//! ```

use super::callback::{CallbackContext, CallbackResult};
use super::env::Env;
use super::handle::{Handle, Taken};
use super::state::HandleState;
use crate::Nanos;
use crate::error::Error;
use crate::executor::wake::doorbell::WakeHandle;
use crate::executor::wake::lazy_now::LazyNow;
use crate::executor::wake::run_queue::RunQueue;
use crate::executor::wake::schedule::nanos;
use crate::handoff::{Inbox, RequestIdentity, RingSlot, SampleInfo};
use crate::middleware::encoding::Encoding;
use crate::middleware::encoding::decode;
use crate::middleware::remedy::SERVICE;
use crate::middleware::{Middleware, PublishError, ReaderId, WriterId};
use crate::platform::label;
use crate::sync::{Arc, AtomicBool, Mutex, Once, Ordering};
use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use core::marker::PhantomData;
use core::sync::atomic::fence;
use core::time::Duration;
use replenish_msg::{CdrError, CdrReader, DecodeError, Service};
use replenish_os::clock;

/// Sends requests of one service. Clones are the same client; any thread may use them.
pub struct Client<S> {
    pub(crate) inner: Arc<ClientInner>,
    service: PhantomData<fn(&S)>,
}

pub(crate) struct ClientInner {
    middleware: Arc<dyn Middleware>,
    writer: WriterId,
    pub(crate) reader: ReaderId,
    pub(crate) inbox: Arc<Inbox>,
    pub(crate) name: String,
    pub(crate) node: String,
    limit: Nanos,
    table: Mutex<Table>,
    wake: Once<WakeHandle>,
    /// What is told before replies that arrived later.
    ahead: Once<Arc<Inbox>>,
    claimed: AtomicBool,
}

impl Drop for ClientInner {
    fn drop(&mut self) {
        if !self.claimed.load(Ordering::Relaxed) {
            // It never belonged to a callback, so nobody else removes it.
            self.middleware.delete_reader(self.reader).ok();
        }
        self.middleware.delete_writer(self.writer);
    }
}

struct Table {
    buffer: Box<[u8]>,
    /// Number, time sent and time limit of each request that waits for its reply.
    waiting: Vec<(u64, Nanos, Nanos)>,
    most: usize,
}

/// Why there is no reply.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum NoReply {
    /// None has come in time. One that comes later is counted as discarded.
    TimedOut,
    /// What has come cannot be decoded. It is counted and told to the error hook as well.
    Undecodable(DecodeError),
}

impl fmt::Display for NoReply {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TimedOut => f.write_str("no reply in time"),
            Self::Undecodable(error) => write!(f, "the reply cannot be decoded: {error}"),
        }
    }
}

impl core::error::Error for NoReply {}

/// A request was not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum CallError {
    /// So many requests wait for their replies already, and more may not.
    TooMany {
        /// How many may.
        limit: usize,
    },
    /// The client has no callback for replies:
    /// [`WorkerBuilder::replies`](crate::WorkerBuilder::replies).
    NoCallback,
    /// The client's callback for replies will not run any more: its executor has ended or was
    /// dropped, its handle was removed, or it has panicked. A client belongs to one callback for
    /// good; another executor needs another client.
    Gone,
    /// The middleware did not send it.
    Send(PublishError),
}

impl fmt::Display for CallError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooMany { limit } => {
                write!(f, "too many requests without reply: the limit is {limit}")
            }
            Self::NoCallback => f.write_str("the client has no callback for replies"),
            Self::Gone => f.write_str(
                "the client's callback for replies is gone: its executor has ended, it was removed, or it panicked",
            ),
            Self::Send(e) => e.fmt(f),
        }
    }
}

impl core::error::Error for CallError {}

impl<S: Service> Client<S> {
    #[expect(clippy::too_many_arguments, reason = "one place makes it")]
    pub(crate) fn new(
        middleware: Arc<dyn Middleware>,
        (reader, writer): (ReaderId, WriterId),
        inbox: Inbox,
        node: String,
        name: String,
        limit: Duration,
        most: usize,
        max_request: usize,
    ) -> Self {
        let inner = ClientInner {
            middleware,
            writer,
            reader,
            inbox: Arc::new(inbox),
            name,
            node,
            limit: nanos(limit),
            table: Mutex::new(Table {
                buffer: alloc::vec![0; max_request].into(),
                waiting: Vec::with_capacity(most),
                most,
            }),
            wake: Once::new(),
            ahead: Once::new(),
            claimed: AtomicBool::new(false),
        };
        Self {
            inner: Arc::new(inner),
            service: PhantomData,
        }
    }

    /// Sends a request and returns its number, which comes back with the reply
    /// ([`CallbackContext::request`]). Does not allocate and waits for nobody.
    ///
    /// # Errors
    /// [`CallError`]; then there will be no callback for it. Nor is there one for requests that
    /// wait for their replies when the executor ends.
    pub fn call(&self, request: &S::Request) -> Result<u64, CallError> {
        self.call_with(|room| replenish_msg::encode(request, room))
    }

    /// As [`call`](Self::call), with a request that `encode` writes.
    pub(crate) fn call_with(
        &self,
        encode: impl FnOnce(&mut [u8]) -> Result<usize, CdrError>,
    ) -> Result<u64, CallError> {
        let inner = &self.inner;
        if !inner.claimed.load(Ordering::Acquire) {
            return Err(CallError::NoCallback);
        }
        let (number, earliest) = {
            // Held while it is sent: the reply must not come before its number is in the table.
            let mut table = inner.table.lock();
            if self.is_gone() {
                return Err(CallError::Gone);
            }
            let limit = table.most;
            if table.waiting.len() >= limit {
                return Err(CallError::TooMany { limit });
            }
            let encoded = encode(&mut table.buffer);
            let encoding = Encoding::of::<S::Request>(SERVICE);
            let len = encoded.map_err(|e| CallError::Send(encoding.failed(e, &table.buffer)))?;
            let payload = table.buffer.get(..len).unwrap_or_default();
            let sent = inner.middleware.request(inner.writer, payload);
            let number = sent.map_err(CallError::Send)?;
            let now = clock::monotonic();
            let end = now.saturating_add(inner.limit);
            let earliest = table.waiting.iter().all(|(_, _, other)| end < *other);
            table.waiting.push((number, now, end));
            (number, earliest)
        };
        fence(Ordering::SeqCst);
        if earliest && let Some(wake) = inner.wake.get() {
            wake.force(); // the worker sleeps too long otherwise
        }
        Ok(number)
    }

    /// Waits until the service has a server, up to so long; looks every millisecond. For set-up.
    ///
    /// # Errors
    /// [`Error::Middleware`] where the middleware does not know: DDS-XRCE with another agent than
    /// that of replenish.
    pub fn wait_for_server(&self, limit: Duration) -> Result<bool, Error> {
        let deadline = clock::monotonic().saturating_add(nanos(limit));
        loop {
            match self.inner.middleware.has_server(self.inner.writer) {
                None => {
                    let unknown = crate::middleware::MiddlewareError::Unsupported(label(
                        "to know of servers, which this agent does not tell",
                    ));
                    return Err(Error::endpoint("client", &self.inner.name, unknown));
                }
                Some(true) => return Ok(true),
                Some(false) if clock::monotonic() >= deadline => return Ok(false),
                Some(false) => clock::sleep_until(clock::monotonic().saturating_add(1_000_000)),
            }
        }
    }

    /// The fully qualified service name.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.inner.name
    }

    /// Whether its callback will not run any more.
    pub(crate) fn is_gone(&self) -> bool {
        self.inner.inbox.is_closed()
    }

    /// Whether it talks through this middleware.
    pub(crate) fn is_of(&self, middleware: &Arc<dyn Middleware>) -> bool {
        Arc::ptr_eq(&self.inner.middleware, middleware)
    }

    /// Samples of this handle, which is on the same worker, are told before replies that arrived
    /// later: of an action, a result must not overtake its goal's feedback.
    pub(crate) fn lets_ahead(&self, handle: &HandleState) {
        if let Some((_, inbox)) = &handle.input {
            self.inner.ahead.set(Arc::clone(inbox)).ok();
        }
    }

    /// It belongs to a callback from now on; `false` if it has belonged to one already.
    pub(crate) fn claim(&self) -> bool {
        !self.inner.claimed.swap(true, Ordering::AcqRel)
    }
}

impl<S> Clone for Client<S> {
    fn clone(&self) -> Self {
        Self {
            inner: Arc::clone(&self.inner),
            service: PhantomData,
        }
    }
}

impl<S> fmt::Debug for Client<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Client")
            .field("service", &self.inner.name)
            .finish_non_exhaustive()
    }
}

pub(crate) struct Replies<S: Service, F> {
    shared: Arc<HandleState>,
    client: Arc<ClientInner>,
    response: S::Response,
    /// The reply taken last, as it came.
    read_slot: Option<RingSlot>,
    info: SampleInfo,
    /// Why there is no response to the request that is told of.
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

    fn earliest(&self) -> Option<Nanos> {
        let table = self.client.table.lock();
        table.waiting.iter().map(|(_, _, end)| *end).min()
    }

    /// Whether the oldest reply waits for samples that came before it. It stays ready, so that it
    /// is looked at again in the next round, which takes one of them first.
    fn is_behind(&self) -> bool {
        let sample = self.client.ahead.get().and_then(|inbox| inbox.oldest());
        let reply = sample.and_then(|_| self.client.inbox.oldest());
        reply.is_some() && sample <= reply
    }

    /// Takes a request out of the table whose limit has passed.
    fn expire(&mut self) -> Option<Taken> {
        let now = clock::monotonic();
        let mut table = self.client.table.lock();
        let at = table.waiting.iter().position(|(_, _, end)| *end <= now)?;
        let (number, _, end) = table.waiting.swap_remove(at);
        drop(table);
        self.shared.counters.received.add(1);
        self.missing = Some(NoReply::TimedOut);
        self.info = SampleInfo {
            request: RequestIdentity::reply(number),
            ..SampleInfo::at(end)
        };
        Some(Taken {
            due: end,
            deadline: None,
        })
    }
}

/// The executor lets go of it, or the handle was never in one that runs.
impl<S: Service, F> Drop for Replies<S, F> {
    fn drop(&mut self) {
        self.client.inbox.close();
    }
}

impl<S, F, R> Handle for Replies<S, F>
where
    S: Service,
    F: FnMut(Result<&S::Response, NoReply>, &CallbackContext<'_>) -> R + Send,
    R: CallbackResult,
{
    fn begin(&mut self, _start: Nanos, wake: &WakeHandle) {
        self.client.wake.set(wake.clone()).ok();
        fence(Ordering::SeqCst);
    }

    fn is_ready(&mut self, now: &LazyNow) -> bool {
        self.client.inbox.waiting() > 0 || self.earliest().is_some_and(|end| end <= now.get())
    }

    fn next_release(&mut self) -> Option<Nanos> {
        self.earliest()
    }

    fn note_release(&mut self, position: usize, run_queue: &mut RunQueue) {
        let release = self.next_release();
        run_queue.next_release_of(position, release);
    }

    fn take(&mut self, env: &Env<'_>) -> Option<Taken> {
        if self.is_behind() {
            return None;
        }
        let Some(slot) = env.next_sample(&self.client.inbox, &mut self.read_slot) else {
            return self.expire();
        };
        self.info = *slot.info();
        self.missing = None;
        let number = self.info.request.number();
        let expected = {
            let mut table = self.client.table.lock();
            let at = table.waiting.iter().position(|(n, _, _)| *n == number);
            at.map(|at| table.waiting.swap_remove(at)).is_some()
        };
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
        })
    }

    fn execute(&mut self, env: &Env<'_>, started: Nanos) {
        let cx = CallbackContext::about(&self.info, env, &self.shared, started);
        let reply = match self.missing {
            Some(why) => Err(why),
            None => Ok(&self.response),
        };
        let result = (self.callback)(reply, &cx);
        result.inspect(&mut |e| self.shared.failed(e, env.events));
    }
}
