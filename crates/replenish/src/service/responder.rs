//! A service's replies: sent from the callback, or later, from any thread.

use crate::handoff::RequestIdentity;
use crate::middleware::encoding::Encoding;
use crate::middleware::remedy::SIZE;
use crate::middleware::{Middleware, PublishError, WriterId};
use crate::sync::{Arc, Mutex};
use alloc::boxed::Box;
use core::fmt;
use core::marker::PhantomData;
use replenish_msg::{Message, Service};

/// The writer of one server's replies.
pub(crate) struct ReplyWriter {
    pub(crate) middleware: Arc<dyn Middleware>,
    pub(crate) writer: WriterId,
    pub(crate) buffer: Mutex<Box<[u8]>>,
}

impl ReplyWriter {
    fn send<M: Message>(&self, to: &RequestIdentity, reply: &M) -> Result<(), PublishError> {
        let mut buffer = self.buffer.lock();
        let encoding = Encoding::of::<M>(SIZE);
        let encoded = replenish_msg::encode(reply, &mut buffer);
        let len = encoded.map_err(|e| encoding.failed(e, &buffer))?;
        let payload = buffer.get(..len).unwrap_or_default();
        self.middleware.reply(self.writer, to, payload)
    }
}

impl Drop for ReplyWriter {
    fn drop(&mut self) {
        self.middleware.delete_writer(self.writer);
    }
}

/// The right to answer one request, once: in the callback, or later from any thread.
///
/// Dropping it leaves the request unanswered; the client then runs into its timeout.
#[must_use = "dropping it leaves the request unanswered"]
pub struct Responder<S> {
    writer: Arc<ReplyWriter>,
    to: RequestIdentity,
    service: PhantomData<fn(&S)>,
}

impl<S: Service> Responder<S> {
    pub(crate) fn new(writer: &Arc<ReplyWriter>, to: RequestIdentity) -> Self {
        Self {
            writer: Arc::clone(writer),
            to,
            service: PhantomData,
        }
    }

    /// The identity of the request.
    #[must_use]
    pub fn request(&self) -> RequestIdentity {
        self.to
    }

    /// Sends the answer. Does not allocate and never waits for a peer.
    ///
    /// # Errors
    /// When it was not sent: the client is gone, no room, too large.
    pub fn reply(self, response: &S::Response) -> Result<(), PublishError> {
        self.writer.send(&self.to, response)
    }

    /// Sends an answer that is encoded already. May be tried again.
    pub(crate) fn reply_bytes(&self, payload: &[u8]) -> Result<(), PublishError> {
        let ReplyWriter {
            middleware, writer, ..
        } = &*self.writer;
        middleware.reply(*writer, &self.to, payload)
    }
}

impl<S> fmt::Debug for Responder<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Responder")
            .field("to", &self.to)
            .finish_non_exhaustive()
    }
}
