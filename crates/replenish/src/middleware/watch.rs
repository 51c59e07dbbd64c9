//! Changes of an endpoint, for a program that watches it: peers, and promises not kept.
//!
//! ```text
//!   middleware, its lock held: update(status) ──► news? ──► lock released ──► ring ──► a worker
//! ```
//!
//! A status has totals. So nothing is queued and nothing is lost: a worker that comes late finds
//! several changes as one.

use super::error::MiddlewareError;
use super::ids::{ReaderId, WriterId};
use crate::platform::label;
use crate::sync::Arc;
use alloc::vec::Vec;

/// An endpoint that is watched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// A reader.
    Reader(ReaderId),
    /// A writer.
    Writer(WriterId),
}

/// Counts of an endpoint, from its creation on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EndStatus {
    /// Peers that it has had, each counted anew when it comes again.
    pub matched_total: u64,
    /// Peers that it has.
    pub matched: u64,
    /// Peers of its topic whose quality of service does not fit.
    pub incompatible: u64,
    /// The policy by which the last one did not fit: `"reliability"`.
    pub policy: &'static str,
    /// Peers of its topic that have another type.
    pub wrong_type: u64,
    /// Samples of a reader that were lost on the way to it.
    pub lost: u64,
    /// Periods of the deadline without a sample.
    pub deadline_missed: u64,
    /// Times that a writer did not show that it is alive for longer than its lease.
    pub liveliness_lost: u64,
    /// Matched writers of a reader that are alive.
    pub alive: u64,
    /// Matched writers of a reader that are not.
    pub not_alive: u64,
}

/// Receives an endpoint's status. No method waits or allocates.
pub trait Watch: Send + Sync {
    /// Keeps the status. Returns whether [`ring`](Self::ring) is due. The caller may hold locks.
    fn update(&self, status: &EndStatus) -> bool;

    /// Wakes the watching worker. The caller holds no lock.
    fn ring(&self);

    /// Whether nobody is interested any more.
    fn is_closed(&self) -> bool;
}

/// The endpoints of a participant that are watched, one watch each.
#[derive(Default)]
pub(super) struct Watches(Vec<(End, Arc<dyn Watch>)>);

impl Watches {
    /// Watches an endpoint.
    pub(super) fn add(&mut self, end: End, watch: &Arc<dyn Watch>) -> Result<(), MiddlewareError> {
        self.0.retain(|(_, watch)| !watch.is_closed());
        if self.0.iter().any(|(known, _)| *known == end) {
            return Err(MiddlewareError::Capacity {
                what: label("callbacks for the events of one endpoint"),
                limit: 1,
            });
        }
        self.0.push((end, Arc::clone(watch)));
        Ok(())
    }

    /// An endpoint is gone.
    pub(super) fn remove(&mut self, end: End) {
        self.0.retain(|(known, _)| *known != end);
    }

    /// Whether no endpoint is watched.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The endpoint in this place and its watch.
    pub(super) fn get(&self, at: usize) -> Option<(End, &Arc<dyn Watch>)> {
        self.0.get(at).map(|(end, watch)| (*end, watch))
    }
}
