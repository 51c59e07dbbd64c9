//! Receipts: what a client wrote is acknowledged when it has reached everybody it is for.
//!
//! ```text
//!   message ──► receipt ──┬── place in a reader's queue ──► stream to its client ──► ACKNACK ──┐
//!                         ├── place in a reader's queue ──► dropped as its QoS says, counted ──┤
//!                         └── stash for readers that are on their way back ──► time is over ───┤
//!                                                                                              ▼
//!                                  the last one lets go of it: the message is settled
//! ```
//!
//! So an agent that dies takes nothing along that its writer could not repeat. Nobody waits for
//! ever: after [`Limits::settle`](crate::Limits::settle) a message counts as settled all the same,
//! and a reader that lags behind that far is not waited for until it has caught up.

use replenish_xrce::Nanos;
use replenish_xrce::wire::StreamId;
use std::sync::{Arc, Mutex, PoisonError};

/// A stream from a client: the client's slot, and the stream.
pub(crate) type Source = (usize, StreamId);

/// Held by all who have not yet done what they must with a message.
pub(crate) type Receipt = Arc<Token>;

/// What a receipt is made of; tells when the last one who held it has let go of it.
#[derive(Debug)]
pub(crate) struct Token {
    /// When its message came.
    pub(crate) since: Nanos,
    source: Source,
    settled: Settled,
}

/// The streams from clients on which something has been settled lately.
#[derive(Clone, Debug, Default)]
pub(crate) struct Settled(Arc<Mutex<Vec<Source>>>);

impl Settled {
    /// A receipt for what `source` has just sent.
    pub(crate) fn receipt(&self, source: Source, now: Nanos) -> Receipt {
        Arc::new(Token {
            since: now,
            source,
            settled: self.clone(),
        })
    }

    /// One of them, which is then forgotten.
    pub(crate) fn take(&self) -> Option<Source> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop()
    }
}

impl Drop for Token {
    fn drop(&mut self) {
        let Settled(sources) = &self.settled;
        let mut sources = sources.lock().unwrap_or_else(PoisonError::into_inner);
        if !sources.contains(&self.source) {
            sources.push(self.source);
        }
    }
}
