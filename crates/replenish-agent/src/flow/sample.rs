//! Samples on their way from writers to readers, and the accounts of their bytes.

use super::delivery_tracker::TRACKER_BYTES;
use super::identity::Identity;
use replenish_xrce::Nanos;
use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The allocator's own bytes of an allocation, with its rounding.
const ALLOCATION: usize = 16;

/// An account of bytes in use with a limit, for all samples together or for one client.
#[derive(Clone, Debug)]
pub(crate) struct Ledger {
    used: Arc<AtomicUsize>,
    limit: usize,
}

/// Bytes taken from a [`Ledger`]; dropping it gives them back.
#[derive(Debug)]
pub(crate) struct Charge {
    used: Arc<AtomicUsize>,
    bytes: usize,
}

impl Ledger {
    pub(crate) fn new(limit: usize) -> Self {
        Self {
            used: Arc::default(),
            limit,
        }
    }

    /// Takes `bytes`, or `None` when that would exceed the limit.
    pub(crate) fn charge(&self, bytes: usize) -> Option<Charge> {
        if bytes > self.free() {
            return None;
        }
        self.used.fetch_add(bytes, Ordering::Relaxed);
        let used = Arc::clone(&self.used);
        Some(Charge { used, bytes })
    }

    /// Bytes that can be taken now.
    pub(crate) fn free(&self) -> usize {
        self.limit.saturating_sub(self.used())
    }

    /// Bytes in use now.
    pub(crate) fn used(&self) -> usize {
        self.used.load(Ordering::Relaxed)
    }
}

impl Drop for Charge {
    fn drop(&mut self) {
        self.used.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}

/// A written payload, shared by the queues of all readers it is for.
#[derive(Clone, Debug)]
pub(crate) struct Sample(Arc<Payload>);

#[derive(Debug)]
struct Payload {
    bytes: Box<[u8]>,
    info: SampleInfo,
    _charge: Charge,
}

/// A sample's metadata.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SampleInfo {
    /// The identity of this request.
    pub(crate) request: Option<Identity>,
    /// The identity of the request that this reply answers.
    pub(crate) reply_to: Option<Identity>,
    /// The end of its lifespan.
    pub(crate) expires: Option<Nanos>,
}

impl Sample {
    /// Bytes that a sample takes besides its own, with the tracker of its message.
    pub(crate) const OVERHEAD: usize =
        size_of::<Payload>() + 2 * size_of::<usize>() + 2 * ALLOCATION + TRACKER_BYTES;

    /// Copies `bytes`, or `None` when the ledger's limit would be exceeded.
    pub(crate) fn new(bytes: &[u8], info: SampleInfo, ledger: &Ledger) -> Option<Self> {
        let payload = Payload {
            _charge: ledger.charge(bytes.len())?,
            bytes: bytes.into(),
            info,
        };
        Some(Self(Arc::new(payload)))
    }

    pub(crate) fn info(&self) -> &SampleInfo {
        &self.0.info
    }

    pub(crate) fn is_expired(&self, now: Nanos) -> bool {
        self.0.info.expires.is_some_and(|at| at <= now)
    }
}

impl Deref for Sample {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.0.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shared_sample_counts_once_and_until_its_last_user_lets_go() {
        let ledger = Ledger::new(10);
        let sample = |len| Sample::new(&vec![0; len], SampleInfo::default(), &ledger);
        let first = sample(8).unwrap();
        let second = first.clone();
        assert_eq!(ledger.used(), 8);
        assert!(sample(3).is_none());
        drop(first);
        assert!(sample(3).is_none());
        drop(second);
        assert_eq!(ledger.used(), 0);
        assert!(sample(10).is_some());
    }
}
