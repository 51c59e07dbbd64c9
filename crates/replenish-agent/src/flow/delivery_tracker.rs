//! Receipts: what a client wrote is acknowledged when it has reached everybody it is for.
//!
//! ```text
//!   message ──► track ──┬── place in a reader's queue ──► stream to its client ──► ACKNACK ──┐
//!                         ├── place in a reader's queue ──► dropped as its QoS says, counted ──┤
//!                         └── stash for readers that are on their way back ──► time is over ───┤
//!                                                                                              ▼
//!                                  the last one lets go of it: the message is confirmed
//! ```
//!
//! So an agent that dies takes nothing along that its writer could not repeat. Nobody waits for
//! ever: after [`Limits::confirm_timeout`](crate::Limits::confirm_timeout) a message counts as confirmed all the same,
//! and a reader that lags behind that far is not waited for until it has caught up.

use replenish_xrce::Nanos;
use replenish_xrce::wire::StreamId;
use std::sync::{Arc, Mutex, PoisonError};

/// A stream from a client: the client's slot, and the stream.
pub(crate) type Source = (usize, StreamId);

/// Held by all who have not yet done what they must with a message.
pub(crate) type TrackerHandle = Arc<DeliveryTracker>;

/// What a track is made of; tells when the last one who held it has let go of it.
#[derive(Debug)]
pub(crate) struct DeliveryTracker {
    /// When its message came.
    pub(crate) since: Nanos,
    source: Source,
    confirmed: ConfirmedStreams,
}

/// The streams from clients on which something has been confirmed lately.
#[derive(Clone, Debug, Default)]
pub(crate) struct ConfirmedStreams(Arc<Mutex<Vec<Source>>>);

impl ConfirmedStreams {
    /// A track for what `source` has just sent.
    pub(crate) fn track(&self, source: Source, now: Nanos) -> TrackerHandle {
        Arc::new(DeliveryTracker {
            since: now,
            source,
            confirmed: self.clone(),
        })
    }

    /// One of them, which is then forgotten.
    pub(crate) fn take(&self) -> Option<Source> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop()
    }
}

impl Drop for DeliveryTracker {
    fn drop(&mut self) {
        let ConfirmedStreams(sources) = &self.confirmed;
        let mut sources = sources.lock().unwrap_or_else(PoisonError::into_inner);
        if !sources.contains(&self.source) {
            sources.push(self.source);
        }
    }
}
