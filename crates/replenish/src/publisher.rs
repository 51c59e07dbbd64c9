//! Publishing from any thread.

use crate::middleware::{Middleware, PublishError, WriterId};
use crate::sync::{Arc, Mutex};
use alloc::boxed::Box;
use alloc::string::String;
use core::fmt;
use core::marker::PhantomData;
use replenish_msg::Message;

/// Publishes messages of type `M` on one topic.
///
/// Clones share one preallocated buffer and may be used from any thread at once; the lock around
/// it has priority inheritance and is held while one message is encoded and handed over.
pub struct Publisher<M> {
    inner: Arc<Inner>,
    message: PhantomData<fn(&M)>,
}

struct Inner {
    middleware: Arc<dyn Middleware>,
    writer: WriterId,
    topic: String,
    buffer: Mutex<Box<[u8]>>,
}

impl<M: Message> Publisher<M> {
    pub(crate) fn new(middleware: Arc<dyn Middleware>, writer: WriterId, topic: String) -> Self {
        let buffer = alloc::vec![0; M::MAX_SIZE].into_boxed_slice();
        Self {
            inner: Arc::new(Inner {
                middleware,
                writer,
                topic,
                buffer: Mutex::new(buffer),
            }),
            message: PhantomData,
        }
    }

    /// Encodes and sends one message. Does not allocate and never waits for a peer, for room or
    /// for the dispatcher; the time it takes is charged to the caller's budget.
    ///
    /// # Errors
    /// When the message was not sent; see [`PublishError`].
    pub fn publish(&self, message: &M) -> Result<(), PublishError> {
        let mut buffer = self.inner.buffer.lock();
        let len = replenish_msg::encode(message, &mut buffer).map_err(PublishError::Encode)?;
        let payload = buffer.get(..len).unwrap_or_default();
        self.inner.middleware.publish(self.inner.writer, payload)
    }

    /// The fully qualified topic name.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.inner.topic
    }
}

impl<M> Clone for Publisher<M> {
    fn clone(&self) -> Self {
        Self {
            inner: Arc::clone(&self.inner),
            message: PhantomData,
        }
    }
}

impl<M> fmt::Debug for Publisher<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Publisher")
            .field("topic", &self.inner.topic)
            .finish_non_exhaustive()
    }
}
