//! Chains in the file: their figures, which the workers of their last stages keep up to date.

use crate::span::Span;
use crate::text;
use crate::word::Word;
use alloc::string::String;
use alloc::vec::Vec;
use core::sync::atomic::Ordering;

/// Most chains of a program in one file.
pub const MAX_CHAINS: usize = 64;
/// Buckets of a chain's histogram, see [`bucket_end`].
pub const CHAIN_BUCKETS: usize = 102;
/// Bytes of a chain.
pub(crate) const CHAIN: usize = 1024;

const WORD: usize = 8;
/// The words of an entry.
const ID: usize = 0;
const LIMIT: usize = 1;
const BOUND: usize = 2;
const WORST: usize = 7;
const ORIGIN: usize = 8;
const NAME: usize = 16;
const BUCKETS: usize = 24;

/// A count of a chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChainCount {
    /// Instances that have begun.
    Begun,
    /// Instances that have ended.
    Ended,
    /// Ended instances that took longer than the limit.
    Exceeded,
    /// The latencies of all that have ended, in ns, added up.
    Sum,
    /// Ended instances in this bucket.
    Bucket(usize),
}

impl ChainCount {
    const fn at(self) -> usize {
        match self {
            Self::Begun => 3,
            Self::Ended => 4,
            Self::Exceeded => 5,
            Self::Sum => 6,
            Self::Bucket(n) if n < CHAIN_BUCKETS => BUCKETS + n,
            Self::Bucket(_) => usize::MAX,
        }
    }
}

/// The largest value in ns that belongs to this bucket of a chain's histogram: a quarter of an
/// octave each, from 1 us on; [`u64::MAX`] for the last one and beyond.
#[must_use]
pub const fn bucket_end(bucket: usize) -> u64 {
    if bucket + 1 >= CHAIN_BUCKETS {
        return u64::MAX;
    }
    let (octave, quarter) = (bucket / 4, bucket as u64 % 4);
    ((4 + quarter) << (octave + 8)) - 1
}

/// A chain before its program starts.
#[derive(Debug, Clone, Copy)]
pub struct PlannedChain<'a> {
    /// Its name; the first 64 bytes are kept.
    pub name: &'a str,
    /// The id of its name in events.
    pub id: u32,
    /// The longest latency that is allowed, ns.
    pub limit: Option<u64>,
    /// The analysed bound, ns.
    pub bound: Option<u64>,
}

/// Writes everything that is known of a chain before its program starts.
pub(crate) fn write<W: Word>(entry: &[W], chain: &PlannedChain<'_>) {
    let words = [
        (ID, u64::from(chain.id)),
        (LIMIT, chain.limit.unwrap_or(0)),
        (BOUND, chain.bound.unwrap_or(0)),
    ];
    for (n, value) in words {
        put(entry, n, value);
    }
    let name = Span {
        start: NAME,
        words: BUCKETS - NAME,
    };
    text::store(name.of(entry), chain.name);
}

/// Adds to a count in this entry. Several threads may.
#[inline]
pub fn add_to_chain<W: Word>(entry: &[W], count: ChainCount, n: u64) {
    if let Some(word) = entry.get(count.at()) {
        word.add(n);
    }
}

/// The instance that took longest: when it began, and its latency, both in ns. For one thread at a
/// time.
pub fn write_chain_worst<W: Word>(entry: &[W], origin: u64, latency: u64) {
    put(entry, ORIGIN, origin);
    put(entry, WORST, latency);
}

fn put<W: Word>(entry: &[W], n: usize, value: u64) {
    if let Some(word) = entry.get(n) {
        word.store(value, Ordering::Relaxed);
    }
}

/// A chain as the file shows it. Times in ns. The name holds no control characters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChainView {
    /// Its name.
    pub name: String,
    /// The id of its name in events; 0: none was left.
    pub id: u32,
    /// The longest latency that is allowed.
    pub limit: Option<u64>,
    /// The analysed bound.
    pub bound: Option<u64>,
    /// Instances that have begun.
    pub begun: u64,
    /// Instances that have ended.
    pub ended: u64,
    /// Ended instances that took longer than the limit.
    pub exceeded: u64,
    /// The latencies of all that have ended, added up.
    pub sum: u64,
    /// When the instance that took longest began (`CLOCK_MONOTONIC`), and its latency.
    pub worst: Option<(u64, u64)>,
    /// Ended instances by bucket, see [`bucket_end`].
    pub histogram: Vec<u64>,
}

impl ChainView {
    pub(crate) fn read(entry: &[u8]) -> Self {
        let word = |n: usize| {
            let word = entry.get(n * WORD..).and_then(<[u8]>::first_chunk);
            word.map_or(0, |word| u64::from_le_bytes(*word))
        };
        let some = |n: usize| Some(word(n)).filter(|value| *value > 0);
        let count = |count: ChainCount| word(count.at());
        let name = entry.get(NAME * WORD..BUCKETS * WORD);
        Self {
            name: text::load(name.unwrap_or_default()),
            id: u32::try_from(word(ID)).unwrap_or(0),
            limit: some(LIMIT),
            bound: some(BOUND),
            begun: count(ChainCount::Begun),
            ended: count(ChainCount::Ended),
            exceeded: count(ChainCount::Exceeded),
            sum: count(ChainCount::Sum),
            worst: some(ORIGIN).map(|origin| (origin, word(WORST))),
            histogram: (0..CHAIN_BUCKETS).map(|n| word(BUCKETS + n)).collect(),
        }
    }

    /// The latency in ns that `percent` of the ended instances do not exceed, rounded up to the end
    /// of its bucket; 0 before one has ended.
    #[must_use]
    pub fn percentile(&self, percent: u8) -> u64 {
        let total: u128 = self.histogram.iter().map(|n| u128::from(*n)).sum();
        let rank = (total * u128::from(percent.min(100))).div_ceil(100).max(1);
        let mut seen = 0;
        let at = self.histogram.iter().position(|count| {
            seen += u128::from(*count);
            seen >= rank
        });
        at.map_or(0, bucket_end)
    }
}
