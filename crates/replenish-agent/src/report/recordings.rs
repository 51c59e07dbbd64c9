//! Boards' recordings on their way through the agent, in a bounded queue that another thread
//! empties.
//!
//! ```text
//!   a client writes to /replenish/recorder ──► up to 512 samples ──► the thread that drains it
//! ```
//!
//! The agent passes each piece on like any other sample, and keeps a copy here after the first
//! request for copies. It neither waits nor allocates: while another thread drains, it only counts.

use replenish_xrce::Nanos;
use replenish_xrce::wire::ClientKey;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// The name on the wire of the topic on which boards send their recordings.
pub(crate) const TOPIC: &str = "rt/replenish/recorder";
/// Bytes of the longest sample that is kept: a piece of 208, with what XRCE and CDR put before it.
const MAX: usize = 256;
/// Pieces that are kept until a thread drains them.
const KEPT: usize = 512;

/// A sample of a board's recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordedSample {
    /// The board's key, as in [`ClientSnapshot::key`](crate::ClientSnapshot::key).
    pub key: [u8; 4],
    /// Time at which it came, in nanoseconds on the agent's monotonic clock.
    pub at: Nanos,
    /// The same since the Unix epoch.
    pub unix: i64,
    bytes: [u8; MAX],
    len: usize,
}

impl RecordedSample {
    /// The sample: `std_msgs/msg/UInt8MultiArray` in CDR.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }
}

/// The queue.
#[derive(Debug, Default)]
pub(crate) struct Recordings {
    wanted: AtomicBool,
    samples: Mutex<VecDeque<RecordedSample>>,
    dropped: AtomicU64,
}

impl Recordings {
    /// Keeps a copy of a sample, if they are wanted; never waits.
    pub(crate) fn note(&self, key: ClientKey, at: Nanos, unix: i64, payload: &[u8]) {
        if !self.wanted.load(Ordering::Relaxed) {
            return;
        }
        let samples = self.samples.try_lock().ok();
        let samples = samples.filter(|s| s.len() < KEPT && payload.len() <= MAX);
        let Some(mut samples) = samples else {
            self.dropped.fetch_add(1, Ordering::Relaxed);
            return;
        };
        let mut bytes = [0; MAX];
        let pairs = bytes.iter_mut().zip(payload);
        pairs.for_each(|(to, from)| *to = *from);
        samples.push_back(RecordedSample {
            key: key.0,
            at,
            unix,
            bytes,
            len: payload.len(),
        });
    }

    /// Takes all samples out, into `into`, and how many were dropped; from the first call on they
    /// are kept.
    pub(crate) fn drain(&self, into: &mut Vec<RecordedSample>) -> u64 {
        let samples = self.samples.lock();
        let mut samples = samples.unwrap_or_else(PoisonError::into_inner);
        samples.reserve_exact(KEPT);
        self.wanted.store(true, Ordering::Relaxed);
        into.extend(samples.drain(..));
        self.dropped.swap(0, Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_keeps_so_many_once_they_are_wanted() {
        let all = Recordings::default();
        let note = |n: usize| all.note(ClientKey([1; 4]), 5, 6, &vec![7; n]);
        note(3);
        let mut got = Vec::new();
        assert_eq!((all.drain(&mut got), got.len()), (0, 0), "nobody wanted it");
        for _ in 0..KEPT + 2 {
            note(200);
        }
        note(MAX + 1);
        assert_eq!((all.drain(&mut got), got.len()), (3, KEPT));
        let first = got[0];
        assert_eq!((first.key, first.at, first.unix), ([1; 4], 5, 6));
        assert_eq!(first.payload(), [7; 200]);
        let held = all.samples.lock().unwrap();
        note(1); // does not wait
        drop(held);
        assert_eq!(all.drain(&mut got), 1);
    }
}
