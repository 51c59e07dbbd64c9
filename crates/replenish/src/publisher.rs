//! Publishing from any thread.

use crate::error::Error;
use crate::handoff::Shared;
use crate::middleware::encoding::Encoding;
use crate::middleware::remedy::SIZE;
use crate::middleware::{Middleware, MiddlewareError, PublishError, WriterId};
use crate::platform::{STD, label, recorder, zeroed};
use crate::stats::Counter;
use crate::sync::{Arc, Mutex};
use alloc::boxed::Box;
use alloc::string::String;
use core::fmt;
use core::marker::PhantomData;
use core::time::Duration;
use replenish_msg::{CdrError, Message, View, Viewed};
use replenish_os::clock;

/// Publishes messages of type `M` on one topic.
///
/// When the last clone is dropped, the middleware forgets it. Clones share one preallocated buffer
/// and may be used from any thread at once; the lock around it has priority inheritance and is held
/// while one message is encoded and handed over.
pub struct Publisher<M> {
    inner: Arc<Inner>,
    message: PhantomData<fn(&M)>,
}

struct Inner {
    middleware: Arc<dyn Middleware>,
    writer: WriterId,
    topic: String,
    /// In recordings.
    name: recorder::NameId,
    buffer: Mutex<Box<[u8]>>,
    too_long: Counter,
}

impl Drop for Inner {
    fn drop(&mut self) {
        self.middleware.delete_writer(self.writer);
    }
}

impl<M: Message> Publisher<M> {
    /// A publisher with a buffer for samples of up to `size` bytes.
    pub(crate) fn new(
        middleware: Arc<dyn Middleware>,
        writer: WriterId,
        topic: String,
        size: usize,
    ) -> Self {
        let buffer = zeroed(size);
        Self {
            inner: Arc::new(Inner {
                middleware,
                writer,
                name: recorder::topic(&topic),
                topic,
                buffer: Mutex::new(buffer),
                too_long: Counter::default(),
            }),
            message: PhantomData,
        }
    }

    /// Encodes and sends one message. Does not allocate and never waits for a peer, for room or
    /// for the dispatcher; the time it takes is charged to the caller's budget.
    ///
    /// # Errors
    /// When the message was not sent; see [`PublishError`]. [`PublishError::TooLong`] of a type
    /// with unbounded fields asks for [`Topic::max_size`](crate::Topic::max_size).
    pub fn publish(&self, message: &M) -> Result<(), PublishError> {
        self.publish_with(|room| replenish_msg::encode(message, room))
    }

    /// As [`publish`](Self::publish), with a view: strings and sequences are encoded from their
    /// place, so that no owned message is needed.
    ///
    /// # Errors
    /// As [`publish`](Self::publish).
    pub fn publish_view(&self, view: &M::View<'_>) -> Result<(), PublishError>
    where
        M: Viewed,
    {
        self.publish_with(|room| view.encode_to(room))
    }

    /// As [`publish`](Self::publish), with a message that `encode` writes.
    pub(crate) fn publish_with(
        &self,
        encode: impl FnOnce(&mut [u8]) -> Result<usize, CdrError>,
    ) -> Result<(), PublishError> {
        let send = |payload: &[u8]| self.inner.middleware.publish(self.inner.writer, payload);
        let encode = if STD {
            match self.encode_in_place(encode) {
                Ok(sent) => return sent,
                Err(encode) => encode,
            }
        } else {
            encode
        };
        self.send_with(encode, send)
    }

    /// Encodes a message where the middleware keeps it, or gives `encode` back: there is no place.
    fn encode_in_place<E>(&self, encode: E) -> Result<Result<(), PublishError>, E>
    where
        E: FnOnce(&mut [u8]) -> Result<usize, CdrError>,
    {
        let Inner {
            middleware, writer, ..
        } = &*self.inner;
        let (mut encode, mut result) = (Some(encode), Ok(0));
        let sent = middleware.publish_with(*writer, &mut |room| {
            result = encode.take().map_or(Ok(0), |encode| {
                encode(room).map_err(|e| Encoding::of::<M>(SIZE).failed(e, room))
            });
            result.as_ref().ok().copied()
        });
        let Some(sent) = sent else {
            return encode.map_or(Ok(Ok(())), Err);
        };
        let len = match result {
            Ok(len) => len,
            Err(error) => {
                self.inner.too_long.add(1);
                return Ok(Err(error));
            }
        };
        recorder::publish(self.inner.name, len, sent.is_err());
        Ok(sent)
    }

    #[inline]
    fn send_with(
        &self,
        encode: impl FnOnce(&mut [u8]) -> Result<usize, CdrError>,
        send: impl FnOnce(&[u8]) -> Result<(), PublishError>,
    ) -> Result<(), PublishError> {
        let mut buffer = self.inner.buffer.lock();
        let encoded = encode(&mut buffer);
        let len = encoded.map_err(|e| {
            self.inner.too_long.add(1);
            Encoding::of::<M>(SIZE).failed(e, &buffer)
        })?;
        let payload = buffer.get(..len).unwrap_or_default();
        let sent = send(payload);
        recorder::publish(self.inner.name, len, sent.is_err());
        sent
    }

    /// As [`publish`](Self::publish), with a message that is in memory. It is encoded if a
    /// subscription needs its bytes, and once.
    #[allow(dead_code, reason = "nothing is shared without feature `std`")]
    pub(crate) fn publish_shared(&self, shared: &Shared, message: &M) -> Result<(), PublishError> {
        let Inner {
            middleware, writer, ..
        } = &*self.inner;
        let sent = middleware.publish_shared(*writer, shared, None);
        if sent != Ok(false) {
            recorder::publish(self.inner.name, 0, sent.is_err());
            return sent.map(|_| ());
        }
        self.send_with(
            |room| replenish_msg::encode(message, room),
            |payload| {
                let sent = middleware.publish_shared(*writer, shared, Some(payload));
                sent.map(|_| ())
            },
        )
    }

    /// Like [`publish`](Self::publish), but while the output queue is full it waits for room,
    /// looking for it every 0.2 ms, until `limit` has passed. In a callback this is blocking: other
    /// callbacks of the worker wait, and its budget is accounted as for any other wait.
    ///
    /// # Errors
    /// [`PublishError::Full`] if there was no room in time; the others at once.
    pub fn publish_within(&self, message: &M, limit: Duration) -> Result<(), PublishError> {
        const GLANCE: u64 = 200_000;
        let limit = u64::try_from(limit.as_nanos()).unwrap_or(u64::MAX);
        let deadline = clock::monotonic().saturating_add(limit);
        loop {
            let result = self.publish(message);
            let now = clock::monotonic();
            if result != Err(PublishError::Full) || now >= deadline {
                return result;
            }
            clock::sleep_until(now.saturating_add(GLANCE).min(deadline));
        }
    }

    /// Asserts that this publisher is alive, for the kind of liveliness that asks for it
    /// ([`Liveliness::ManualByTopic`](crate::qos::Liveliness)); a message asserts it as well. Does
    /// not allocate and never waits.
    ///
    /// # Errors
    /// [`PublishError::UnknownWriter`] where the middleware does not know of it: DDS-XRCE.
    pub fn assert_liveliness(&self) -> Result<(), PublishError> {
        self.inner.middleware.assert_liveliness(self.inner.writer)
    }

    /// The middleware and the writer that encoded samples go to.
    pub(crate) fn target(&self) -> (&Arc<dyn Middleware>, WriterId) {
        (&self.inner.middleware, self.inner.writer)
    }

    /// Messages that were refused since they were longer than the topic's size or a field's bound.
    #[must_use]
    pub fn too_long(&self) -> u64 {
        self.inner.too_long.get()
    }

    /// Number of subscriptions that get its messages at this moment, those of other programs
    /// included; `None` where the middleware does not know it: DDS-XRCE. Does not wait.
    #[must_use]
    pub fn subscriptions(&self) -> Option<usize> {
        self.inner.middleware.matched_readers(self.inner.writer)
    }

    /// Waits for at most `limit` until a subscription gets its messages; looks every millisecond.
    /// For set-up.
    ///
    /// # Errors
    /// [`Error::Middleware`] where the middleware does not know: DDS-XRCE.
    pub fn wait_for_subscription(&self, limit: Duration) -> Result<bool, Error> {
        let limit = u64::try_from(limit.as_nanos()).unwrap_or(u64::MAX);
        let deadline = clock::monotonic().saturating_add(limit);
        loop {
            match self.subscriptions() {
                None => {
                    let unknown = label("to know of subscriptions, which no agent tells");
                    let unknown = MiddlewareError::Unsupported(unknown);
                    return Err(Error::endpoint("publisher", &self.inner.topic, unknown));
                }
                Some(0) if clock::monotonic() >= deadline => return Ok(false),
                Some(0) => clock::sleep_until(clock::monotonic().saturating_add(1_000_000)),
                Some(_) => return Ok(true),
            }
        }
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
