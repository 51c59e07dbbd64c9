//! The ring: one writer that overwrites its oldest records, and readers that it never waits for.
//!
//! ```text
//!   begun = n + 1 ── release fence ── the four words of record n ── done = n + 1 (release)
//!
//!   done (acquire) ── copy records [done - slots, done) ── acquire fence ── begun:
//!                     a record n with n + slots < begun may have been overwritten: dropped
//! ```
//!
//! A reader that sees one word of a record that was overwritten sees, behind its fence, the count
//! `begun` that was stored before that record: so it drops the slot. A record carries the lap in
//! which it was written, too: a reader of a dead program's file needs no cursor to be right.

use crate::event::Event;
use crate::word::Word;
use core::ops::Range;
use core::sync::atomic::Ordering;

/// Words before the first slot.
pub(crate) const HEAD: usize = 8;
/// Words of a slot.
pub(crate) const SLOT: usize = 4;

/// The number of records that fit into `words` words: a power of two, or 0.
pub(crate) const fn slots(words: usize) -> u64 {
    match words.saturating_sub(HEAD) / SLOT {
        0 => 0,
        n => 1 << n.ilog2(),
    }
}

/// The writing end of one ring. Wait-free: two counters and four words are stored.
#[derive(Debug)]
pub struct Writer {
    next: u64,
    /// The logarithm of the number of slots.
    shift: u32,
}

impl Writer {
    /// For a ring of zeros in so many words, at least 12; `None` for fewer.
    #[must_use]
    pub const fn new(words: usize) -> Option<Self> {
        match slots(words) {
            0 => None,
            slots => Some(Self {
                next: 0,
                shift: slots.ilog2(),
            }),
        }
    }

    /// Writes one record over the oldest. `ring` is the same memory at every call, and no other
    /// writer's; fewer words than were given to [`new`](Self::new) leave the record out.
    #[inline]
    pub fn write<W: Word>(&mut self, ring: &[W], event: &Event) {
        let n = self.next;
        #[expect(clippy::cast_possible_truncation, reason = "below the number of slots")]
        let at = HEAD + (n & (self.slots() - 1)) as usize * SLOT;
        let Some(([begun, done], Some(slot))) = ring
            .first_chunk()
            .map(|head| (head, ring.get(at..).and_then(<[W]>::first_chunk::<SLOT>)))
        else {
            return;
        };
        self.next = n + 1;
        begun.store(n + 1, Ordering::Relaxed);
        W::fence(Ordering::Release);
        for (word, value) in slot.iter().zip(event.words(n >> self.shift)) {
            word.store(value, Ordering::Relaxed);
        }
        done.store(n + 1, Ordering::Release);
    }

    /// Records that the ring holds.
    #[must_use]
    pub const fn slots(&self) -> u64 {
        1 << self.shift
    }

    /// Records written so far.
    #[must_use]
    pub const fn written(&self) -> u64 {
        self.next
    }
}

/// The result of reading a ring.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Copied {
    /// Records that were handed over.
    pub read: u64,
    /// Records that were overwritten before they were read: `read + overwritten` is all that was
    /// written since the place where reading began.
    pub overwritten: u64,
    /// Records that make no sense although the counters say that they are whole. None, unless the
    /// memory is somebody else's.
    pub torn: u64,
    /// Where to go on reading.
    pub next: u64,
}

/// Hands over every record from `from` on that is still there, in the order of writing.
///
/// `copy` is the reader's own memory, at least as many records as the ring has slots; with less,
/// nothing is read.
pub fn read<W: Word>(
    ring: &[W],
    from: u64,
    copy: &mut [[u64; 4]],
    sink: impl FnMut(Event),
) -> Copied {
    let slots = slots(ring.len());
    let suits = slots > 0 && copy.len() as u64 >= slots;
    let Some([begun, done]) = ring.first_chunk().filter(|_| suits) else {
        return Copied::default();
    };
    let end = done.load(Ordering::Acquire);
    let range = first(from, end, slots)..end;
    for n in range.clone() {
        let at = place(n, slots);
        let Some(slot) = ring
            .get(HEAD + at * SLOT..)
            .and_then(<[W]>::first_chunk::<SLOT>)
        else {
            continue;
        };
        if let Some(copied) = copy.get_mut(at) {
            *copied = slot.each_ref().map(|word| word.load(Ordering::Relaxed));
        }
    }
    W::fence(Ordering::Acquire);
    let begun = begun.load(Ordering::Relaxed);
    kept(from, range, begun, slots, |at| copy.get(at).copied(), sink)
}

/// The first record that can still be there.
pub(crate) fn first(from: u64, end: u64, slots: u64) -> u64 {
    from.min(end).max(end.saturating_sub(slots))
}

fn place(n: u64, slots: u64) -> usize {
    usize::try_from(n & (slots - 1)).unwrap_or(usize::MAX)
}

/// Hands over the records of `range` that were not overwritten up to `begun`.
pub(crate) fn kept(
    from: u64,
    range: Range<u64>,
    begun: u64,
    slots: u64,
    slot: impl Fn(usize) -> Option<[u64; 4]>,
    mut sink: impl FnMut(Event),
) -> Copied {
    let mut copied = Copied {
        next: range.end,
        ..Copied::default()
    };
    let whole = begun.saturating_sub(slots).clamp(range.start, range.end);
    copied.overwritten = whole.saturating_sub(from.min(range.end));
    for n in whole..range.end {
        let lap = n >> slots.ilog2();
        match slot(place(n, slots)).and_then(|words| Event::from_words(words, lap)) {
            Some(event) => {
                copied.read += 1;
                sink(event);
            }
            None => copied.torn += 1,
        }
    }
    copied
}
