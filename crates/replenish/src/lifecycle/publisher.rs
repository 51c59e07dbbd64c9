//! Publishers that are silent unless their node is active.

use super::machine::State;
use super::node::Lifecycle;
use crate::error::Error;
use crate::executor::{CallbackContext, Topic};
use crate::middleware::PublishError;
use crate::publisher::Publisher;
use crate::qos::Qos;
use crate::sync::{Arc, AtomicU64, Ordering};
use core::fmt;
use replenish_msg::Message;

impl Lifecycle {
    /// A publisher that publishes while the node is active and else counts what it has withheld.
    ///
    /// # Errors
    /// As [`Node::publisher`](crate::Node::publisher).
    pub fn publisher<'t, M: Message>(
        &self,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
    ) -> Result<ManagedPublisher<M>, Error> {
        let publisher = self.inner.node.publisher(topic, qos)?;
        Ok(ManagedPublisher::new(publisher, self.clone()))
    }
}

/// A publisher of a managed node. Clones share the counter.
pub struct ManagedPublisher<M> {
    publisher: Publisher<M>,
    lifecycle: Lifecycle,
    withheld: Arc<AtomicU64>,
}

impl<M: Message> ManagedPublisher<M> {
    pub(super) fn new(publisher: Publisher<M>, lifecycle: Lifecycle) -> Self {
        Self {
            publisher,
            lifecycle,
            withheld: Arc::new(AtomicU64::new(0)),
        }
    }

    /// Publishes if the node is active; whether it was.
    ///
    /// # Errors
    /// As [`Publisher::publish`].
    pub fn publish(&self, message: &M) -> Result<bool, PublishError> {
        if self.withholds() {
            return Ok(false);
        }
        self.publisher.publish(message).map(|()| true)
    }

    /// Whether the node is not active; counts that it was not.
    fn withholds(&self) -> bool {
        let silent = self.lifecycle.state() != State::Active;
        self.withheld.fetch_add(silent.into(), Ordering::Relaxed);
        silent
    }

    /// As [`publish`](Self::publish), behind the output barrier of the worker whose callback this
    /// is: see [`CallbackContext::publish`]. The state at this moment decides.
    ///
    /// # Errors
    /// As [`CallbackContext::publish`].
    pub fn publish_in(&self, cx: &CallbackContext<'_>, message: &M) -> Result<bool, PublishError> {
        if self.withholds() {
            return Ok(false);
        }
        cx.publish(&self.publisher, message).map(|()| true)
    }

    /// Number of messages that were not published because the node was not active.
    #[must_use]
    pub fn withheld(&self) -> u64 {
        self.withheld.load(Ordering::Relaxed)
    }

    /// The fully qualified topic name.
    #[must_use]
    pub fn topic(&self) -> &str {
        self.publisher.topic()
    }
}

impl<M> Clone for ManagedPublisher<M> {
    fn clone(&self) -> Self {
        Self {
            publisher: self.publisher.clone(),
            lifecycle: self.lifecycle.clone(),
            withheld: Arc::clone(&self.withheld),
        }
    }
}

impl<M> fmt::Debug for ManagedPublisher<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ManagedPublisher")
            .field("publisher", &self.publisher)
            .field("withheld", &self.withheld.load(Ordering::Relaxed))
            .finish_non_exhaustive()
    }
}
