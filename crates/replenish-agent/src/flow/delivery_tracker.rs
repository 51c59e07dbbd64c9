//! The tracker of a message: the message is confirmed once it has reached all its readers.
//!
//! ```text
//!   message ──► tracker ──┬── sample in a reader's queue ──► stream to its client ──► ACKNACK ──┐
//!                         ├── sample in a reader's queue ──► dropped by its QoS, counted ───────┤
//!                         └── sample kept for returning readers ──► the window is over ─────────┤
//!                                                                                               ▼
//!                                     the last handle is dropped: the message is confirmed
//! ```
//!
//! So an agent that dies loses no sample that its writer could not repeat. The wait is bounded:
//! after [`Limits::confirm_timeout`](crate::Limits::confirm_timeout) a message counts as confirmed,
//! and a reader that lags behind that far is not waited for until it has caught up.

use replenish_xrce::Nanos;
use replenish_xrce::wire::StreamId;
use std::sync::{Arc, Mutex, PoisonError};

/// A stream from a client: the client's slot, and the stream.
pub(crate) type Source = (usize, StreamId);

/// A handle of each queue and stream that a sample of the message is still in.
pub(crate) type TrackerHandle = Arc<DeliveryTracker>;

/// Bytes of a tracker with its counts, and the allocator's own.
pub(crate) const TRACKER_BYTES: usize = size_of::<DeliveryTracker>() + 2 * size_of::<usize>() + 16;

/// Reports its stream as confirmed when the last handle is dropped.
#[derive(Debug)]
pub(crate) struct DeliveryTracker {
    /// The time of arrival of its message.
    pub(crate) since: Nanos,
    source: Source,
    confirmed: ConfirmedStreams,
}

/// The streams from clients on which messages were confirmed lately.
#[derive(Clone, Debug, Default)]
pub(crate) struct ConfirmedStreams(Arc<Mutex<Vec<Source>>>);

impl ConfirmedStreams {
    /// A tracker of the message that `source` has just sent.
    pub(crate) fn track(&self, source: Source, now: Nanos) -> TrackerHandle {
        Arc::new(DeliveryTracker {
            since: now,
            source,
            confirmed: self.clone(),
        })
    }

    /// Takes one of them out.
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
