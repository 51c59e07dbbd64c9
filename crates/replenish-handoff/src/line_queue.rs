//! Lines of a log on their way from real-time threads to one ordinary thread.
//!
//! ```text
//!   any thread: claim a place (one exchange) ── store the words ── publish the place
//!   one reader: the oldest place published? ── copy the words ── free the place
//! ```
//!
//! A slot's `turn` says whose turn it is: `n` for the writer of place `n`, `n + 1` for its reader,
//! `n + capacity` for the next writer. A writer waits for nobody: it gives up when the queue is
//! full, or when other writers took the place [`TRIES`] times in a row. A writer that is preempted
//! between claim and publication holds up the reader alone.

use crate::sync::{AtomicU64, AtomicUsize, Ordering};
use alloc::boxed::Box;

/// The number of places that a writer tries to claim before it gives up.
const TRIES: usize = if cfg!(loom) { 2 } else { 64 };

struct LineSlot<const WORDS: usize> {
    turn: AtomicUsize,
    words: [AtomicU64; WORDS],
}

/// A bounded queue of lines of `WORDS` words: many writers, one reader.
pub struct LineQueue<const WORDS: usize> {
    slots: Box<[LineSlot<WORDS>]>,
    tail: AtomicUsize,
    /// One less than the number of slots, which is a power of two.
    mask: usize,
}

/// The reader's place in the queue. With two readers of one queue, lines go astray.
#[derive(Debug, Default)]
pub struct LineReader {
    head: usize,
}

impl<const WORDS: usize> LineQueue<WORDS> {
    /// With room for `lines` lines, rounded up to a power of two of at least 2. Allocates here
    /// only.
    #[must_use]
    pub fn new(lines: usize) -> Self {
        let slots = lines.max(2).next_power_of_two();
        let slot = |turn| LineSlot {
            turn: AtomicUsize::new(turn),
            words: [const { 0 }; WORDS].map(AtomicU64::new),
        };
        Self {
            slots: (0..slots).map(slot).collect(),
            tail: AtomicUsize::new(0),
            mask: slots - 1,
        }
    }

    /// Puts a line into the queue; `false` if it did not fit. Words beyond `WORDS` are left out,
    /// words that `line` does not have keep whatever an earlier line put there.
    #[must_use]
    pub fn push(&self, line: &[u64]) -> bool {
        let mut place = self.tail.load(Ordering::Relaxed);
        for _ in 0..TRIES {
            let Some(slot) = self.slots.get(place & self.mask) else {
                return false;
            };
            let turn = slot.turn.load(Ordering::Acquire);
            if turn == place {
                let next = place.wrapping_add(1);
                let claimed =
                    self.tail
                        .compare_exchange(place, next, Ordering::Relaxed, Ordering::Relaxed);
                match claimed {
                    Ok(_) => {
                        for (word, value) in slot.words.iter().zip(line) {
                            word.store(*value, Ordering::Relaxed);
                        }
                        slot.turn.store(next, Ordering::Release);
                        return true;
                    }
                    Err(now) => place = now,
                }
            } else if turn.wrapping_sub(place) > usize::MAX / 2 {
                return false; // its line of the last lap is still there
            } else {
                place = self.tail.load(Ordering::Relaxed);
            }
        }
        false
    }

    /// Copies the oldest line; `None` if there is none, or if its writer is still at it.
    pub fn pop(&self, reader: &mut LineReader) -> Option<[u64; WORDS]> {
        let slot = self.slots.get(reader.head & self.mask)?;
        let published = reader.head.wrapping_add(1);
        if slot.turn.load(Ordering::Acquire) != published {
            return None;
        }
        let mut line = [0; WORDS];
        for (value, word) in line.iter_mut().zip(&slot.words) {
            *value = word.load(Ordering::Relaxed);
        }
        let free = reader.head.wrapping_add(self.slots.len());
        slot.turn.store(free, Ordering::Release);
        reader.head = published;
        Some(line)
    }

    /// The number of lines so far, wrapping: those that writers are at included.
    #[must_use]
    pub fn pushed(&self) -> usize {
        self.tail.load(Ordering::Relaxed)
    }
}

impl LineReader {
    /// The number of lines that were taken, wrapping.
    #[must_use]
    pub const fn taken(&self) -> usize {
        self.head
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn lines_come_in_order_and_those_too_many_are_refused() {
        let queue = LineQueue::<2>::new(3); // 4
        let mut reader = LineReader::default();
        for lap in 0..5 {
            for n in 0..4 {
                assert!(queue.push(&[lap, n]));
            }
            assert!(!queue.push(&[lap, 4]));
            for n in 0..4 {
                assert_eq!(queue.pop(&mut reader), Some([lap, n]));
            }
            assert_eq!(queue.pop(&mut reader), None);
        }
        assert_eq!((queue.pushed(), reader.taken()), (20, 20));
    }
}
