//! The layout of the file, and the writing of all of it but the rings.

use crate::chain::{self, CHAIN, MAX_CHAINS, PlannedChain};
use crate::checksum::checksum;
use crate::ring;
use crate::span::Span;
use crate::text;
use crate::word::Word;
use alloc::vec::Vec;
use core::fmt;
use core::sync::atomic::Ordering;

/// Most threads of a program in one file.
pub const MAX_THREADS: usize = 1024;
/// Names in one file.
pub const MAX_NAMES: usize = 2048;
/// Bytes of the longest file.
pub const MAX_BYTES: u64 = 1 << 30;
/// Bytes of a thread's ring, at least.
pub const MIN_RING: usize = 4096;
/// Bytes of a thread's ring, at most.
pub const MAX_RING: usize = 64 << 20;

pub(crate) const MAGIC: u64 = u64::from_le_bytes(*b"rplnlive");
pub(crate) const VERSION: u64 = 1;
/// Bytes of the header, of a thread, of a name.
pub(crate) const HEADER: usize = 4096;
pub(crate) const THREAD: usize = 256;
pub(crate) const NAME: usize = 128;
/// Bytes of the header that its checksum covers.
pub(crate) const CHECKED: usize = 224;
/// Where the counts of dumps stand, behind the checksum.
pub(crate) const DUMPS: usize = CHECKED + 8;
const PAGE: usize = 4096;
const WORD: usize = 8;

/// The work of a thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Takes samples from the middleware.
    Dispatcher,
    /// Runs callbacks.
    Worker,
}

impl Role {
    pub(crate) const fn number(self) -> u64 {
        match self {
            Self::Dispatcher => 1,
            Self::Worker => 2,
        }
    }
}

/// The kind of a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NameKind {
    /// A handle's id.
    Handle,
    /// A topic that is published.
    Topic,
    /// A mark of the program.
    Mark,
    /// A chain.
    Chain,
}

impl NameKind {
    pub(crate) const fn number(self) -> u64 {
        match self {
            Self::Handle => 1,
            Self::Topic => 2,
            Self::Mark => 3,
            Self::Chain => 4,
        }
    }

    pub(crate) const fn from_number(number: u64) -> Option<Self> {
        match number {
            1 => Some(Self::Handle),
            2 => Some(Self::Topic),
            3 => Some(Self::Mark),
            4 => Some(Self::Chain),
            _ => None,
        }
    }
}

/// The clocks at one moment, in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Clocks {
    /// `CLOCK_MONOTONIC`, which every event has.
    pub monotonic: u64,
    /// `CLOCK_BOOTTIME`.
    pub boottime: u64,
    /// `CLOCK_REALTIME`.
    pub realtime: u64,
}

/// A thread before it starts.
#[derive(Debug, Clone, Copy)]
pub struct Planned<'a> {
    /// Its name; the first 64 bytes are kept.
    pub name: &'a str,
    /// Its work.
    pub role: Role,
    /// The CPU it is pinned to.
    pub cpu: Option<usize>,
    /// Budget and period in nanoseconds.
    pub budget: Option<(u64, u64)>,
}

/// A thread's places in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ThreadSpan {
    /// Its entry in the table.
    pub entry: Span,
    /// Its ring.
    pub ring: Span,
    /// The ring of its budget, if it has one.
    pub budget: Option<Span>,
}

/// Where everything stands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    /// Bytes of the file.
    pub bytes: usize,
    /// By thread.
    pub threads: Vec<ThreadSpan>,
    /// The table of names.
    pub names: Span,
    /// By chain.
    pub chains: Vec<Span>,
}

/// The request cannot be laid out; names the field and the allowed range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LayoutError {
    /// Bytes of a ring.
    Ring(usize),
    /// Number of threads.
    Threads(usize),
    /// Number of chains.
    Chains(usize),
    /// Bytes of the whole file.
    Bytes(usize),
}

impl fmt::Display for LayoutError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ring(n) => write!(f, "bytes of a ring: {n}, allowed {MIN_RING}..={MAX_RING}"),
            Self::Threads(n) => write!(f, "threads: {n}, allowed 1..={MAX_THREADS}"),
            Self::Chains(n) => write!(f, "chains: {n}, allowed up to {MAX_CHAINS}"),
            Self::Bytes(n) => write!(f, "bytes of all rings: {n}, allowed up to {MAX_BYTES}"),
        }
    }
}

impl core::error::Error for LayoutError {}

impl Plan {
    /// Lays out the file for these threads, with rings of `ring` bytes each, `MIN_RING..=MAX_RING`;
    /// the ring of a budget gets half of that.
    ///
    /// # Errors
    /// Numbers out of their ranges.
    pub fn new(threads: &[Planned<'_>], ring: usize) -> Result<Self, LayoutError> {
        Self::with_chains(threads, 0, ring)
    }

    /// The same, with room for the figures of up to [`MAX_CHAINS`] chains.
    ///
    /// # Errors
    /// Numbers out of their ranges.
    pub fn with_chains(
        threads: &[Planned<'_>],
        chains: usize,
        ring: usize,
    ) -> Result<Self, LayoutError> {
        if !(MIN_RING..=MAX_RING).contains(&ring) {
            return Err(LayoutError::Ring(ring));
        }
        if !(1..=MAX_THREADS).contains(&threads.len()) {
            return Err(LayoutError::Threads(threads.len()));
        }
        if chains > MAX_CHAINS {
            return Err(LayoutError::Chains(chains));
        }
        let mut end = HEADER;
        let mut take = |bytes: usize| {
            let start = end / WORD;
            end = (end + bytes).next_multiple_of(PAGE);
            Span {
                start,
                words: bytes / WORD,
            }
        };
        let table = take(threads.len() * THREAD);
        let names = take(MAX_NAMES * NAME);
        let room = take(chains * CHAIN).start;
        let chains = (0..chains).map(|n| Span {
            start: room + n * (CHAIN / WORD),
            words: CHAIN / WORD,
        });
        let sized = |bytes: usize| {
            let slots = ring::slots(bytes / WORD + ring::HEAD);
            let slots = usize::try_from(slots).unwrap_or(0);
            (ring::HEAD + slots * ring::SLOT) * WORD
        };
        let mut laid = Vec::with_capacity(threads.len());
        for (n, thread) in threads.iter().enumerate() {
            laid.push(ThreadSpan {
                entry: Span {
                    start: table.start + n * (THREAD / WORD),
                    words: THREAD / WORD,
                },
                ring: take(sized(ring)),
                budget: thread.budget.map(|_| take(sized(ring / 2))),
            });
        }
        if end as u64 > MAX_BYTES {
            return Err(LayoutError::Bytes(end));
        }
        Ok(Self {
            bytes: end,
            threads: laid,
            names,
            chains: chains.collect(),
        })
    }

    /// Writes everything that is known of the chains; before [`write`](Self::write).
    pub fn write_chains<W: Word>(&self, memory: &[W], chains: &[PlannedChain<'_>]) {
        for (chain, at) in chains.iter().zip(&self.chains) {
            chain::write(at.of(memory), chain);
        }
    }

    /// Writes everything that is known before the threads start, the header last; `memory` holds
    /// zeros.
    pub fn write<W: Word>(
        &self,
        memory: &[W],
        program: &str,
        pid: u32,
        clocks: Clocks,
        threads: &[Planned<'_>],
    ) {
        let put = |at: usize, value: u64| {
            if let Some(word) = memory.get(at) {
                word.store(value, Ordering::Relaxed);
            }
        };
        let bytes = |words: usize| (words * WORD) as u64;
        for (thread, at) in threads.iter().zip(&self.threads) {
            let entry = at.entry.start;
            let (budget, period) = thread.budget.unwrap_or_default();
            let low = at.budget.unwrap_or_default();
            let fields = [
                (1, thread.role.number()),
                (2, thread.cpu.map_or(0, |cpu| cpu as u64 + 1)),
                (3, budget),
                (4, period),
                (5, bytes(at.ring.start)),
                (6, bytes(at.ring.words)),
                (7, bytes(low.start)),
                (8, bytes(low.words)),
                (14, budget),
            ];
            fields.iter().for_each(|(n, value)| put(entry + n, *value));
            text::store(field(memory, entry + 16, 8), thread.name);
        }
        let table = self.threads.first().map_or(0, |t| t.entry.start);
        let chains = self.chains.first();
        let chains = chains.map_or(0, |c| bytes(c.start) + self.chains.len() as u64);
        let header = [
            VERSION,
            self.bytes as u64,
            u64::from(pid),
            threads.len() as u64,
            bytes(table),
            MAX_NAMES as u64,
            bytes(self.names.start),
            clocks.monotonic,
            clocks.boottime,
            clocks.realtime,
            chains,
        ];
        let numbered = header.iter().enumerate();
        numbered.for_each(|(n, value)| put(n + 1, *value));
        text::store(field(memory, 12, 16), program);
        // The checksum covers the magic, which is written last: a file without it is not taken.
        let words = memory.get(..CHECKED / WORD).unwrap_or_default();
        let mut checked: Vec<u8> = MAGIC.to_le_bytes().into();
        for word in words.iter().skip(1) {
            checked.extend(word.load(Ordering::Relaxed).to_le_bytes());
        }
        put(CHECKED / WORD, checksum(&checked));
        if let Some(word) = memory.first() {
            word.store(MAGIC, Ordering::Release);
        }
    }
}

fn field<W>(memory: &[W], start: usize, words: usize) -> &[W] {
    Span { start, words }.of(memory)
}

/// The dumps that were written, and the triggers that were suppressed.
pub fn write_dumps<W: Word>(memory: &[W], written: u64, suppressed: u64) {
    let counts = field(memory, DUMPS / WORD, 2);
    for (word, value) in counts.iter().zip([written, suppressed]) {
        word.store(value, Ordering::Relaxed);
    }
}

/// The thread of this entry has begun: its id.
pub fn write_tid<W: Word>(entry: &[W], tid: u64) {
    if let Some(word) = entry.first() {
        word.store(tid, Ordering::Relaxed);
    }
}

/// The name of the thread of this entry, where it was not known beforehand; the first 64 bytes are
/// kept.
pub fn write_thread_name<W: Word>(entry: &[W], name: &str) {
    text::store(field(entry, 16, 8), name);
}

/// The policy that the kernel granted to the thread of this entry; the first 64 bytes are kept.
pub fn write_policy<W: Word>(entry: &[W], policy: &str) {
    text::store(field(entry, 24, 8), policy);
}

/// A thread's account so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RunningTotals {
    /// CPU time at the high priority, ns; all of it without a budget.
    pub high: u64,
    /// CPU time at the low priority, ns.
    pub low: u64,
    /// Times that the budget ran out.
    pub exhaustions: u64,
    /// Times that it came back.
    pub replenishments: u64,
    /// Budget left, ns.
    pub available: u64,
    /// Whether it is at its low level.
    pub is_low: bool,
}

/// Brings the account in this entry up to date.
#[inline]
pub fn write_totals<W: Word>(entry: &[W], totals: &RunningTotals) {
    let values = [
        totals.high,
        totals.low,
        totals.exhaustions,
        totals.replenishments,
        totals.available,
        u64::from(totals.is_low),
    ];
    for (word, value) in field(entry, 10, values.len()).iter().zip(values) {
        word.store(value, Ordering::Relaxed);
    }
}

/// Writes the name with this id, 1 to [`MAX_NAMES`], into the table; the first 120 bytes are kept.
pub fn write_name<W: Word>(names: &[W], id: u32, kind: NameKind, name: &str) {
    let Some(at) = (id as usize).checked_sub(1) else {
        return;
    };
    let words = NAME / WORD;
    if let Some((state, room)) = field(names, at * words, words).split_first() {
        text::store(room, name);
        state.store(kind.number(), Ordering::Release);
    }
}
