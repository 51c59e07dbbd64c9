//! Samples on their way from a writer to readers, and the bound on all of them together.

use std::collections::VecDeque;
use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A written payload, shared by the queues of all readers it is for.
#[derive(Clone, Debug)]
pub(crate) struct Sample(Arc<Payload>);

#[derive(Debug)]
struct Payload {
    bytes: Box<[u8]>,
    queued: Arc<AtomicUsize>,
}

impl Deref for Sample {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.0.bytes
    }
}

impl Drop for Payload {
    fn drop(&mut self) {
        self.queued.fetch_sub(self.bytes.len(), Ordering::Relaxed);
    }
}

/// Hands out samples while fewer bytes than a limit are held by them.
#[derive(Debug)]
pub(crate) struct Pool {
    queued: Arc<AtomicUsize>,
    limit: usize,
}

impl Pool {
    pub(crate) fn new(limit: usize) -> Self {
        Self {
            queued: Arc::default(),
            limit,
        }
    }

    /// Copies `bytes` into a new sample, or `None` when that would exceed the limit.
    pub(crate) fn sample(&self, bytes: &[u8]) -> Option<Sample> {
        let queued = self.queued();
        if bytes.len() > self.limit.saturating_sub(queued) {
            return None;
        }
        self.queued.fetch_add(bytes.len(), Ordering::Relaxed);
        let payload = Payload {
            bytes: bytes.into(),
            queued: Arc::clone(&self.queued),
        };
        Some(Sample(Arc::new(payload)))
    }

    /// Bytes held by samples now.
    pub(crate) fn queued(&self) -> usize {
        self.queued.load(Ordering::Relaxed)
    }
}

/// The samples that wait for one reader: at most `depth`, the oldest go first (keep-last).
#[derive(Debug)]
pub(crate) struct Queue {
    samples: VecDeque<Sample>,
    depth: usize,
}

impl Queue {
    /// An empty queue for `depth` samples, at least one.
    pub(crate) fn new(depth: usize) -> Self {
        Self {
            samples: VecDeque::new(),
            depth: depth.max(1),
        }
    }

    /// Adds a sample; returns whether the oldest one had to go.
    pub(crate) fn push(&mut self, sample: Sample) -> bool {
        let full = self.samples.len() >= self.depth;
        if full {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
        full
    }

    pub(crate) fn front(&self) -> Option<&Sample> {
        self.samples.front()
    }

    pub(crate) fn pop(&mut self) -> Option<Sample> {
        self.samples.pop_front()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_goes_when_the_queue_is_full() {
        let pool = Pool::new(100);
        let mut queue = Queue::new(2);
        let dropped: Vec<bool> = (0..4)
            .map(|i| queue.push(pool.sample(&[i]).unwrap()))
            .collect();
        assert_eq!(dropped, [false, false, true, true]);
        let left: Vec<u8> = std::iter::from_fn(|| queue.pop()).map(|s| s[0]).collect();
        assert_eq!(left, [2, 3]);
    }

    #[test]
    fn a_shared_sample_counts_once_and_until_its_last_reader_lets_go() {
        let pool = Pool::new(10);
        let sample = pool.sample(&[0; 8]).unwrap();
        let (mut a, mut b) = (Queue::new(1), Queue::new(1));
        a.push(sample.clone());
        b.push(sample);
        assert_eq!(pool.queued(), 8);
        assert!(pool.sample(&[0; 3]).is_none());
        a.pop();
        assert!(pool.sample(&[0; 3]).is_none());
        b.pop();
        assert_eq!(pool.queued(), 0);
        assert!(pool.sample(&[0; 10]).is_some());
    }
}
