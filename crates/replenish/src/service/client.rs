//! A service's client: requests from any thread, each with a number and a time limit; replies and
//! expired limits as callbacks of one worker.
//!
//! ```text
//!   call: lock the table ── send ── note number and limit ── unlock ── ring, if it is the earliest
//!   worker: reply ──► in the table? forget it, callback(reply) : too late, discarded
//!           limit passed ──► forget it, callback(timeout)
//!   give_up: forget it; its reply is too late
//! ```

use crate::Nanos;
use crate::error::Error;
use crate::executor::wake::doorbell::WakeHandle;
use crate::executor::wake::schedule::nanos;
use crate::handoff::Inbox;
use crate::middleware::encoding::Encoding;
use crate::middleware::remedy::SIZE;
use crate::middleware::{Middleware, MiddlewareError, ReaderId, WriterId};
use crate::platform::label;
use crate::service::calls::Calls;
use crate::service::error::CallError;
use crate::sync::{Arc, AtomicBool, Mutex, Once, Ordering};
use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use core::sync::atomic::fence;
use core::time::Duration;
use replenish_msg::{CdrError, Service};
use replenish_os::clock;

/// Sends requests of one service. Clones are the same client; any thread may use them.
pub struct Client<S: Service> {
    pub(crate) inner: Arc<ClientInner>,
    calls: Arc<Once<Arc<Calls<S>>>>,
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
    /// Wakes the worker of the callback for replies.
    pub(crate) wake: Once<WakeHandle>,
    /// Samples that are delivered before replies that arrived later.
    ahead: Once<Arc<Inbox>>,
    claimed: AtomicBool,
}

impl Drop for ClientInner {
    fn drop(&mut self) {
        if !self.claimed.load(Ordering::Relaxed) {
            // It never belonged to a callback, so nothing else removes it.
            self.middleware.delete_reader(self.reader).ok();
        }
        self.middleware.delete_writer(self.writer);
    }
}

impl ClientInner {
    /// The earliest time limit of a request without reply.
    pub(crate) fn earliest(&self) -> Option<Nanos> {
        let table = self.table.lock();
        table.waiting.iter().map(|(_, _, end)| *end).min()
    }

    /// Whether the oldest reply waits for samples that came before it. The handle stays ready, so
    /// that the next round, which takes one of those samples first, looks at it again.
    pub(crate) fn is_behind(&self) -> bool {
        let sample = self.ahead.get().and_then(|inbox| inbox.oldest());
        let reply = sample.and_then(|_| self.inbox.oldest());
        reply.is_some() && sample <= reply
    }

    /// Takes a request out of the table whose limit has passed: its number and its limit.
    pub(crate) fn expire(&self, now: Nanos) -> Option<(u64, Nanos)> {
        let mut table = self.table.lock();
        let at = table.waiting.iter().position(|(_, _, end)| *end <= now)?;
        let (number, _, end) = table.waiting.swap_remove(at);
        Some((number, end))
    }

    /// Takes the request of this number out of the table; `false` if no such request waits.
    pub(crate) fn settle(&self, number: u64) -> bool {
        let mut table = self.table.lock();
        let at = table.waiting.iter().position(|(n, _, _)| *n == number);
        at.map(|at| table.waiting.swap_remove(at)).is_some()
    }
}

struct Table {
    buffer: Box<[u8]>,
    /// Number, time sent and time limit of each request that waits for its reply.
    waiting: Vec<(u64, Nanos, Nanos)>,
    most: usize,
}

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
            calls: Arc::new(Once::new()),
        }
    }

    /// Sends a request and returns its number, which comes back with the reply
    /// ([`CallbackContext::request`](crate::CallbackContext::request)). Does not allocate and never
    /// waits.
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
            let encoding = Encoding::of::<S::Request>(SIZE);
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

    /// The reply to this request is not awaited any more: it leaves the table, and its reply is
    /// discarded when it comes.
    pub(crate) fn give_up(&self, number: u64) {
        self.inner.settle(number);
    }

    /// Waits for at most `limit` until the service has a server; looks every millisecond. For
    /// set-up.
    ///
    /// # Errors
    /// [`Error::Middleware`] where the middleware does not know: DDS-XRCE with another agent than
    /// that of replenish.
    pub fn wait_for_server(&self, limit: Duration) -> Result<bool, Error> {
        let deadline = clock::monotonic().saturating_add(nanos(limit));
        loop {
            match self.inner.middleware.has_server(self.inner.writer) {
                None => {
                    let unknown = MiddlewareError::Unsupported(label(
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

    /// The most requests that may wait for their replies.
    pub(crate) fn most(&self) -> usize {
        self.inner.table.lock().most
    }

    /// Replies that are awaited, if a worker takes them.
    pub(crate) fn calls(&self) -> Option<&Calls<S>> {
        self.calls.get().map(|calls| &**calls)
    }

    /// A worker takes replies that are awaited.
    pub(crate) fn set_calls(&self, calls: Arc<Calls<S>>) {
        self.calls.set(calls).ok();
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

    /// Samples of this inbox, whose handle is on the same worker, come before replies that arrived
    /// later: of an action, a result must not overtake its goal's feedback.
    pub(crate) fn lets_ahead(&self, inbox: &Arc<Inbox>) {
        self.inner.ahead.set(Arc::clone(inbox)).ok();
    }

    /// Claims the client for a callback; `false` if it has belonged to one already.
    pub(crate) fn claim(&self) -> bool {
        !self.inner.claimed.swap(true, Ordering::AcqRel)
    }
}

impl<S: Service> Clone for Client<S> {
    fn clone(&self) -> Self {
        Self {
            inner: Arc::clone(&self.inner),
            calls: Arc::clone(&self.calls),
        }
    }
}

impl<S: Service> fmt::Debug for Client<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Client")
            .field("service", &self.inner.name)
            .finish_non_exhaustive()
    }
}
