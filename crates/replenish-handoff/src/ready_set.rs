//! The handles of a worker that may have something to do: threads that bring input mark them, the
//! worker looks at them.
//!
//! ```text
//!   bring input ──► mark(slot) ──► ring the bell
//!   worker: drain ──► look at the marked handles ──► … ──► nothing marked: sleep on the bell
//! ```
//!
//! So a worker's round costs what its input costs, however many handles it has. No thread may
//! leave the mark out: input comes first, then the mark, then the bell, which is sticky. A
//! worker that drained before the mark finds the bell rung when it goes to sleep.

use crate::sync::{AtomicUsize, Ordering};
use alloc::vec::Vec;

/// Slots per word.
const BITS: usize = usize::BITS as usize;

/// A bit per slot. Marking is async-signal-safe: one atomic operation, or two.
pub struct ReadySet {
    words: Vec<AtomicUsize>,
}

impl ReadySet {
    /// For slots below `slots`. Allocates here only.
    #[inline]
    pub fn new(slots: usize) -> Self {
        let count = slots.div_ceil(BITS);
        let mut words = Vec::with_capacity(count);
        (0..count).for_each(|_| words.push(AtomicUsize::new(0)));
        Self { words }
    }

    /// The handle in `slot` may have something to do. Slots beyond the last are ignored.
    pub fn mark(&self, slot: usize) {
        if let Some(word) = self.words.get(slot / BITS) {
            let bit = 1 << (slot % BITS);
            word.fetch_or(bit, Ordering::Release);
        }
    }

    /// Worker: takes all marks.
    pub fn drain(&self, mut marked: impl FnMut(usize)) {
        for (at, word) in self.words.iter().enumerate() {
            if word.load(Ordering::Relaxed) == 0 {
                continue;
            }
            let mut bits = word.swap(0, Ordering::Acquire);
            while bits != 0 {
                marked(at * BITS + bits.trailing_zeros() as usize);
                bits &= bits - 1;
            }
        }
    }
}
