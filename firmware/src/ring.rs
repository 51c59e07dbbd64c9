//! A ring of bytes between an interrupt and one task: one side puts, the other takes.

use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};
use core::{ptr, slice};

/// Holds up to `N` bytes, a power of two. The counters run on and wrap.
pub struct Ring<const N: usize> {
    bytes: [AtomicU8; N],
    put: AtomicU32,
    taken: AtomicU32,
}

impl<const N: usize> Ring<N> {
    /// An empty ring.
    pub const fn new() -> Self {
        const { assert!(N.is_power_of_two()) };
        Self {
            bytes: [const { AtomicU8::new(0) }; N],
            put: AtomicU32::new(0),
            taken: AtomicU32::new(0),
        }
    }

    /// Number of bytes that wait.
    pub fn len(&self) -> usize {
        let put = self.put.load(Ordering::Acquire);
        put.wrapping_sub(self.taken.load(Ordering::Acquire)) as usize
    }

    /// Whether none waits.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether there is no room.
    pub fn is_full(&self) -> bool {
        self.len() >= N
    }

    /// Bytes put so far, modulo 2^32.
    pub fn total_put(&self) -> u32 {
        self.put.load(Ordering::Acquire)
    }

    /// Bytes taken so far, modulo 2^32.
    pub fn total_taken(&self) -> u32 {
        self.taken.load(Ordering::Acquire)
    }

    /// Puts a byte; whether there was room.
    pub fn push(&self, byte: u8) -> bool {
        if self.is_full() {
            return false;
        }
        let at = self.put.load(Ordering::Relaxed);
        self.bytes[at as usize % N].store(byte, Ordering::Relaxed);
        self.put.store(at.wrapping_add(1), Ordering::Release);
        true
    }

    /// Shows `look` the bytes that lie together at the front, and takes them; whether there may be
    /// more. `None`: there was nothing.
    pub fn lend(&self, look: impl FnOnce(&[u8])) -> Option<bool> {
        let at = self.taken.load(Ordering::Relaxed);
        let len = self.put.load(Ordering::Acquire).wrapping_sub(at) as usize;
        if len == 0 {
            return None;
        }
        let front = &self.bytes[at as usize % N..];
        let together = len.min(front.len());
        // SAFETY: as many lie there, and nothing is put where something waits.
        look(unsafe { slice::from_raw_parts(front.as_ptr().cast::<u8>(), together) });
        self.taken
            .store(at.wrapping_add(together as u32), Ordering::Release);
        Some(together < len)
    }

    /// Takes as many bytes as there are and `into` has room for; how many.
    pub fn take(&self, into: &mut [u8]) -> usize {
        let len = self.len().min(into.len());
        let at = self.taken.load(Ordering::Relaxed);
        let first = at as usize % N;
        let (front, back) = into[..len].split_at_mut(len.min(N - first));
        copy(&self.bytes[first..], front);
        copy(&self.bytes, back);
        self.taken
            .store(at.wrapping_add(len as u32), Ordering::Release);
        len
    }

    /// Takes the oldest byte.
    pub fn pop(&self) -> Option<u8> {
        if self.is_empty() {
            return None;
        }
        let at = self.taken.load(Ordering::Relaxed);
        let byte = self.bytes[at as usize % N].load(Ordering::Relaxed);
        self.taken.store(at.wrapping_add(1), Ordering::Release);
        Some(byte)
    }
}

impl<const N: usize> Default for Ring<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// The first of `from`, all at once: nothing is put where something waits.
fn copy(from: &[AtomicU8], to: &mut [u8]) {
    assert!(from.len() >= to.len());
    // SAFETY: as long as both; the other side writes to `from` again after it has been taken.
    unsafe { ptr::copy_nonoverlapping(from.as_ptr().cast::<u8>(), to.as_mut_ptr(), to.len()) };
}
