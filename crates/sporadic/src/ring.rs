//! Chunks of budget and the fixed-capacity ring that holds them in order of time.

use crate::Nanos;

/// An amount of budget that belongs to a point in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Chunk {
    /// Time at which the amount becomes (or became) available.
    pub time: Nanos,
    /// The CPU time, in ns.
    pub amount: Nanos,
}

/// A first-in first-out queue of up to `N` chunks without allocation.
#[derive(Debug, Clone)]
pub(crate) struct Ring<const N: usize> {
    slots: [Chunk; N],
    first: usize,
    len: usize,
}

impl<const N: usize> Ring<N> {
    pub(crate) const fn new() -> Self {
        Self {
            slots: const { [Chunk { time: 0, amount: 0 }; N] },
            first: 0,
            len: 0,
        }
    }

    pub(crate) const fn len(&self) -> usize {
        self.len
    }

    /// Index of the `i`-th oldest chunk. `i < N`.
    const fn slot(&self, i: usize) -> usize {
        let at = self.first + i;
        if at >= N { at - N } else { at }
    }

    pub(crate) fn front(&self) -> Option<Chunk> {
        self.iter().next()
    }

    pub(crate) fn back_mut(&mut self) -> Option<&mut Chunk> {
        let at = self.slot(self.len.checked_sub(1)?);
        self.slots.get_mut(at)
    }

    pub(crate) fn pop_front(&mut self) -> Option<Chunk> {
        let chunk = self.front()?;
        self.first = self.slot(1);
        self.len -= 1;
        Some(chunk)
    }

    /// Appends `chunk`; false (and nothing happens) if `limit` or all `N` slots are in use.
    pub(crate) fn push_back(&mut self, chunk: Chunk, limit: usize) -> bool {
        if self.len >= limit || self.len >= N {
            return false;
        }
        let at = self.slot(self.len);
        if let Some(slot) = self.slots.get_mut(at) {
            *slot = chunk;
            self.len += 1;
        }
        true
    }

    /// Oldest first.
    pub(crate) fn iter(&self) -> impl Iterator<Item = Chunk> + '_ {
        (0..self.len).filter_map(|i| self.slots.get(self.slot(i)).copied())
    }

    /// Changes every chunk, the oldest first.
    pub(crate) fn each(&mut self, mut change: impl FnMut(&mut Chunk)) {
        for i in 0..self.len {
            let at = self.slot(i);
            self.slots.get_mut(at).into_iter().for_each(&mut change);
        }
    }
}

/// Two rings are equal if they hold the same chunks, wherever in memory.
impl<const N: usize> PartialEq for Ring<N> {
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other.iter())
    }
}

impl<const N: usize> Eq for Ring<N> {}
