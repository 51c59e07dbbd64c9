//! A heap for set-up. When everything is made it is sealed: an allocation after that is reported,
//! refused and (by Rust's rule) a panic of the task that asked.
//!
//! ```text
//!   region: | block | block | (freed) | block |        never used        |
//!                              └─ free list, first fit     └─ top
//! ```
//!
//! Freed blocks are cut to what is asked for and not joined; set-up frees little.
#![expect(unsafe_code, reason = "a global allocator")]

use super::panics::Who;
use crate::rtos::critical_section::Guarded;
use core::alloc::{GlobalAlloc, Layout};
use core::cell::UnsafeCell;
use core::ptr;

const ALIGN: usize = 8;

/// Use of a heap, in bytes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct HeapUse {
    /// Handed out at least once.
    pub used: usize,
    /// The size of the heap.
    pub size: usize,
    /// Allocations that were asked for after [`SealedHeap::seal`], and refused.
    pub refused: u32,
}

/// A heap of `N` bytes in static memory; the image's `#[global_allocator]`.
pub struct SealedHeap<const N: usize> {
    region: Region<N>,
    state: Guarded<HeapState>,
}

#[repr(C, align(8))]
struct Region<const N: usize>(UnsafeCell<[u8; N]>);

// SAFETY: the bytes are only reached through blocks, which the state hands out once.
unsafe impl<const N: usize> Sync for Region<N> {}

struct HeapState {
    top: usize,
    free: *mut Free,
    sealed: bool,
    refused: u32,
}

// SAFETY: the pointer leads into the region of the same value.
unsafe impl Send for HeapState {}

/// The head of a freed block.
struct Free {
    bytes: usize,
    next: *mut Free,
}

impl<const N: usize> SealedHeap<N> {
    /// An empty heap.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            region: Region(UnsafeCell::new([0; N])),
            state: Guarded::new(HeapState {
                top: 0,
                free: ptr::null_mut(),
                sealed: false,
                refused: 0,
            }),
        }
    }

    /// From now on every allocation fails.
    pub fn seal(&self) {
        self.state.with(|s| s.sealed = true);
    }

    /// Use of this heap.
    #[must_use]
    pub fn usage(&self) -> HeapUse {
        self.state.with(|s| HeapUse {
            used: s.top,
            size: N,
            refused: s.refused,
        })
    }

    fn take(&self, state: &mut HeapState, bytes: usize) -> *mut u8 {
        let mut link = &raw mut state.free;
        loop {
            // SAFETY: `link` is the list's head or the `next` of a freed block.
            let block = unsafe { *link };
            if block.is_null() {
                break;
            }
            // SAFETY: a freed block, written by `dealloc`.
            let free = unsafe { &mut *block };
            if let Some(rest) = free.bytes.checked_sub(bytes) {
                let mut next = free.next;
                if rest > 0 {
                    // SAFETY: the rest of the block, a multiple of 8 bytes, which is what a head
                    // takes.
                    let tail = unsafe { block.cast::<u8>().add(bytes) }.cast::<Free>();
                    // SAFETY: inside of the block.
                    unsafe { tail.write(Free { bytes: rest, next }) };
                    next = tail;
                }
                // SAFETY: as above; takes the block out of the list.
                unsafe { *link = next };
                return block.cast();
            }
            link = &raw mut free.next;
        }
        let start = state.top;
        match start.checked_add(bytes).filter(|&end| end <= N) {
            Some(end) => {
                state.top = end;
                // SAFETY: start <= N, inside of the region.
                unsafe { self.region.0.get().cast::<u8>().add(start) }
            }
            None => ptr::null_mut(),
        }
    }
}

impl<const N: usize> Default for SealedHeap<N> {
    fn default() -> Self {
        Self::new()
    }
}

fn rounded(layout: Layout) -> usize {
    layout.size().max(size_of::<Free>()).next_multiple_of(ALIGN)
}

// SAFETY: blocks are disjoint, aligned to 8 and stay inside of the region; larger alignments are
// refused.
unsafe impl<const N: usize> GlobalAlloc for SealedHeap<N> {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if layout.align() > ALIGN {
            return ptr::null_mut();
        }
        let (block, sealed) = self.state.with(|s| {
            if s.sealed {
                s.refused += 1;
                return (ptr::null_mut(), true);
            }
            (self.take(s, rounded(layout)), false)
        });
        if block.is_null() {
            let why = if sealed {
                b": the heap is sealed: ".as_slice()
            } else {
                b": the heap is full: "
            };
            Who::running().says(why, layout.size(), b" bytes refused\n");
        }
        block
    }

    #[inline(never)] // or it is repeated wherever something is dropped
    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        let bytes = rounded(layout);
        self.state.with(|s| {
            let next = s.free;
            let free = block.cast::<Free>();
            // SAFETY: the block is the caller's to give back, aligned and large enough for this.
            unsafe { free.write(Free { bytes, next }) };
            s.free = free;
        });
    }
}
