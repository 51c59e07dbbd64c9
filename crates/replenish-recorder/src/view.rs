//! Reading a file that somebody else wrote, and may be writing: every length is checked, nothing is
//! believed, memory is bounded.

use crate::chain::{CHAIN, ChainView, MAX_CHAINS};
use crate::checksum::checksum;
use crate::event::Event;
use crate::layout::{
    CHECKED, Clocks, DUMPS, HEADER, MAGIC, MAX_BYTES, MAX_NAMES, MAX_RING, MAX_THREADS, NAME,
    NameKind, Role, RunningTotals, THREAD, VERSION,
};
use crate::ring::{self, Copied};
use crate::text;
use alloc::string::String;
use alloc::vec;
use alloc::vec::Vec;
use core::fmt;
#[cfg(target_has_atomic = "64")]
use core::sync::atomic::{AtomicU64, Ordering};

/// Bytes that are read by place, such as a file (`pread`, never `mmap`: a file that is truncated
/// under a map ends its reader).
pub trait Source {
    /// Bytes it has now.
    fn bytes(&self) -> u64;
    /// Fills `buffer` from `offset` on; `false` if that reaches beyond the end, or cannot be read.
    fn fill(&self, offset: u64, buffer: &mut [u8]) -> bool;
}

/// The program's own memory.
#[cfg(target_has_atomic = "64")]
impl Source for [AtomicU64] {
    fn bytes(&self) -> u64 {
        self.len() as u64 * 8
    }

    fn fill(&self, offset: u64, buffer: &mut [u8]) -> bool {
        let start = usize::try_from(offset / 8).unwrap_or(usize::MAX);
        let words = self.get(start..start.saturating_add(buffer.len() / 8));
        let Some(words) =
            words.filter(|_| offset.is_multiple_of(8) && buffer.len().is_multiple_of(8))
        else {
            return false;
        };
        for (to, word) in buffer.chunks_exact_mut(8).zip(words) {
            // Acquire: what is read after it, such as the count `begun`, is not older.
            to.copy_from_slice(&word.load(Ordering::Acquire).to_ne_bytes());
        }
        true
    }
}

impl Source for [u8] {
    fn bytes(&self) -> u64 {
        self.len() as u64
    }

    fn fill(&self, offset: u64, buffer: &mut [u8]) -> bool {
        let start = usize::try_from(offset).unwrap_or(usize::MAX);
        let from = self.get(start..start.saturating_add(buffer.len()));
        from.map(|from| buffer.copy_from_slice(from)).is_some()
    }
}

/// Why a file is not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Invalid {
    /// It is no recording, or is not complete yet.
    NoRecording,
    /// A version this reader does not know.
    Version(u64),
    /// The header's checksum is wrong.
    Checksum,
    /// It is shorter than its header says, or longer than allowed.
    Length,
    /// A field has a value out of its range.
    Field(&'static str),
}

impl fmt::Display for Invalid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoRecording => f.write_str("it is no recording of a replenish program"),
            Self::Version(version) => {
                write!(
                    f,
                    "version {version} of the format: this program reads {VERSION}"
                )
            }
            Self::Checksum => f.write_str("the checksum of its header is wrong"),
            Self::Length => write!(
                f,
                "its length is not what its header says, or more than {MAX_BYTES} bytes"
            ),
            Self::Field(name) => write!(f, "its field {name:?} is out of range"),
        }
    }
}

impl core::error::Error for Invalid {}

/// A thread as the file shows it. Texts hold no control characters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ThreadView {
    /// Its name.
    pub name: String,
    /// Its work.
    pub role: Role,
    /// Its id, in the program's own pid namespace; 0 before it began.
    pub tid: u64,
    /// The CPU it is pinned to.
    pub cpu: Option<u64>,
    /// The policy that the kernel granted.
    pub policy: String,
    /// Budget and period, ns.
    pub budget: Option<(u64, u64)>,
    /// Its account.
    pub totals: RunningTotals,
    /// Offset and bytes of its ring.
    pub(crate) ring: (u64, u64),
    /// Offset and bytes of the ring of its budget.
    pub(crate) budget_ring: Option<(u64, u64)>,
}

/// A program as its file shows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct View {
    /// Its name, without control characters.
    pub program: String,
    /// Its process id, in its own pid namespace.
    pub pid: u32,
    /// The clocks at its start.
    pub clocks: Clocks,
    /// Dumps that were written.
    pub dumps: u64,
    /// Triggers that got no dump.
    pub dumps_suppressed: u64,
    /// Its threads; a place without name that none has taken is left out.
    pub threads: Vec<ThreadView>,
    /// Its chains.
    pub chains: Vec<ChainView>,
    names: u64,
}

/// A little-endian word of bytes; 0 beyond their end.
fn word(bytes: &[u8], n: usize) -> u64 {
    let word = bytes.get(n * 8..).and_then(<[u8]>::first_chunk);
    word.map_or(0, |word| u64::from_le_bytes(*word))
}

fn part(bytes: &[u8], start: usize, len: usize) -> &[u8] {
    bytes.get(start..start + len).unwrap_or_default()
}

impl View {
    /// Reads header and threads.
    ///
    /// # Errors
    /// The reason why it is not taken; nothing of it is used then.
    pub fn read<S: Source + ?Sized>(source: &S) -> Result<Self, Invalid> {
        let mut header = vec![0; HEADER];
        if source.bytes() < HEADER as u64 || !source.fill(0, &mut header) {
            return Err(Invalid::NoRecording);
        }
        if word(&header, 0) != MAGIC {
            return Err(Invalid::NoRecording);
        }
        if word(&header, 1) != VERSION {
            return Err(Invalid::Version(word(&header, 1)));
        }
        if word(&header, CHECKED / 8) != checksum(part(&header, 0, CHECKED)) {
            return Err(Invalid::Checksum);
        }
        let length = word(&header, 2);
        if length > MAX_BYTES || source.bytes() < length {
            return Err(Invalid::Length);
        }
        let pid = u32::try_from(word(&header, 3)).map_err(|_| Invalid::Field("pid"))?;
        let threads = word(&header, 4);
        let count = usize::try_from(threads).ok();
        let count = count.filter(|n| (1..=MAX_THREADS).contains(n));
        let count = count.ok_or(Invalid::Field("threads"))?;
        let table = inside(word(&header, 5), (count * THREAD) as u64, length);
        let table = table.ok_or(Invalid::Field("threads"))?;
        let names = inside(word(&header, 7), (MAX_NAMES * NAME) as u64, length);
        let names = names.filter(|_| word(&header, 6) == MAX_NAMES as u64);
        let names = names.ok_or(Invalid::Field("names"))?;
        let mut entries = vec![0; count * THREAD];
        if !source.fill(table, &mut entries) {
            return Err(Invalid::Length);
        }
        let entries = entries.chunks_exact(THREAD);
        let threads: Result<Vec<_>, _> = entries.map(|e| ThreadView::read(e, length)).collect();
        let mut threads = threads?;
        threads.retain(|thread| thread.tid != 0 || !thread.name.is_empty());
        Ok(Self {
            program: text::load(part(&header, 96, 128)),
            pid,
            clocks: Clocks {
                monotonic: word(&header, 8),
                boottime: word(&header, 9),
                realtime: word(&header, 10),
            },
            dumps: word(&header, DUMPS / 8),
            dumps_suppressed: word(&header, DUMPS / 8 + 1),
            threads,
            chains: chains(source, word(&header, 11), length)?,
            names,
        })
    }

    /// The names, by id; an id that has none yet has `None`, as 0 has.
    #[must_use]
    pub fn names<S: Source + ?Sized>(&self, source: &S) -> Vec<Option<(NameKind, String)>> {
        let mut table = vec![0; MAX_NAMES * NAME];
        if !source.fill(self.names, &mut table) {
            return Vec::new();
        }
        let entries = table.chunks_exact(NAME);
        let name = |entry: &[u8]| {
            let kind = NameKind::from_number(word(entry, 0))?;
            Some((kind, text::load(part(entry, 8, NAME - 8))))
        };
        core::iter::once(None).chain(entries.map(name)).collect()
    }
}

/// The chains of a table whose offset and number stand in one word.
fn chains<S: Source + ?Sized>(
    source: &S,
    table: u64,
    length: u64,
) -> Result<Vec<ChainView>, Invalid> {
    let wrong = Invalid::Field("chains");
    let (offset, count) = (table & !PAGE_MASK, table & PAGE_MASK);
    if table == 0 {
        return Ok(Vec::new());
    }
    let count = usize::try_from(count).map_err(|_| wrong)?;
    if count > MAX_CHAINS || inside(offset, (count * CHAIN) as u64, length).is_none() {
        return Err(wrong);
    }
    let mut entries = vec![0; count * CHAIN];
    if !source.fill(offset, &mut entries) {
        return Err(Invalid::Length);
    }
    Ok(entries.chunks_exact(CHAIN).map(ChainView::read).collect())
}

/// The bits of an offset that are 0 where a table begins.
const PAGE_MASK: u64 = 4095;

/// `offset`, if so many bytes from there on lie inside a file of `length`, and on a word.
fn inside(offset: u64, bytes: u64, length: u64) -> Option<u64> {
    let end = offset.checked_add(bytes)?;
    (offset >= HEADER as u64 && end <= length && offset.is_multiple_of(8)).then_some(offset)
}

impl ThreadView {
    fn read(entry: &[u8], length: u64) -> Result<Self, Invalid> {
        let span = |n: usize| {
            let (offset, bytes) = (word(entry, n), word(entry, n + 1));
            let most = MAX_RING as u64 + 64;
            let fits = bytes <= most && inside(offset, bytes, length).is_some();
            fits.then_some((offset, bytes))
                .ok_or(Invalid::Field("ring"))
        };
        let budget = (word(entry, 3), word(entry, 4));
        Ok(Self {
            name: text::load(part(entry, 128, 64)),
            role: match word(entry, 1) {
                1 => Role::Dispatcher,
                2 => Role::Worker,
                _ => return Err(Invalid::Field("role")),
            },
            tid: word(entry, 0),
            cpu: word(entry, 2).checked_sub(1),
            policy: text::load(part(entry, 192, 64)),
            budget: (budget.1 > 0).then_some(budget),
            totals: RunningTotals {
                high: word(entry, 10),
                low: word(entry, 11),
                exhaustions: word(entry, 12),
                replenishments: word(entry, 13),
                available: word(entry, 14),
                is_low: word(entry, 15) == 1,
            },
            ring: span(5)?,
            budget_ring: match word(entry, 7) {
                0 => None,
                _ => Some(span(7)?),
            },
        })
    }

    /// The events of the thread that are still there, in the order of writing.
    pub fn events<S: Source + ?Sized>(&self, source: &S) -> (Vec<Event>, Copied) {
        events(source, self.ring, 0)
    }

    /// The events from record `from` on that are still there: [`Copied::next`] of the call before.
    /// Reads no more of the file than it returns.
    pub fn events_since<S: Source + ?Sized>(&self, source: &S, from: u64) -> (Vec<Event>, Copied) {
        events(source, self.ring, from)
    }

    /// Records that the thread has written so far.
    pub fn written<S: Source + ?Sized>(&self, source: &S) -> u64 {
        counters(source, self.ring.0).map_or(0, |(_, done)| done)
    }

    /// The events of its budget; none without a budget.
    pub fn budget_events<S: Source + ?Sized>(&self, source: &S) -> (Vec<Event>, Copied) {
        self.budget_ring
            .map_or_else(Default::default, |ring| events(source, ring, 0))
    }
}

/// The two counters of a ring: records begun, records done.
pub(crate) fn counters<S: Source + ?Sized>(source: &S, offset: u64) -> Option<(u64, u64)> {
    let mut head = [0; 16];
    let read = source.fill(offset, &mut head);
    read.then(|| (word(&head, 0), word(&head, 1)))
}

fn events<S: Source + ?Sized>(
    source: &S,
    (offset, bytes): (u64, u64),
    since: u64,
) -> (Vec<Event>, Copied) {
    let words = usize::try_from(bytes / 8).unwrap_or(0);
    let slots = ring::slots(words);
    let Some((_, end)) = counters(source, offset).filter(|_| slots > 0) else {
        return Default::default();
    };
    let from = ring::first(since, end, slots);
    let count = (end - from).min(slots);
    let len = usize::try_from(count).unwrap_or(0);
    // The records lie in one piece, or in two: up to the end of the ring, and from its start.
    let start = from % slots;
    let split = count.min(slots - start);
    let mut copy = vec![0; len * 32];
    let (first, second) = copy.split_at_mut(usize::try_from(split).unwrap_or(0) * 32);
    let here = offset + 64;
    let filled =
        source.fill(here + start * 32, first) && (second.is_empty() || source.fill(here, second));
    if !filled {
        return Default::default();
    }
    let Some((begun, _)) = counters(source, offset) else {
        return Default::default();
    };
    let slot = |at: usize| {
        let at = (at as u64).wrapping_sub(start) % slots;
        let bytes = part(&copy, usize::try_from(at).ok()?.checked_mul(32)?, 32);
        Some([0, 1, 2, 3].map(|n| word(bytes, n)))
    };
    let mut events = Vec::with_capacity(len);
    let range = from..from + count;
    let copied = ring::kept(since, range, begun, slots, slot, |event| events.push(event));
    (events, copied)
}
