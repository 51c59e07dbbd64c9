//! A global allocator that counts what threads allocate while it is armed.
//!
//! ```ignore
//! #[global_allocator]
//! static ALLOC: CountingAllocator = CountingAllocator::new();
//! // … set up, start spinning …
//! exempt_this_thread();          // the test's own thread may allocate
//! ALLOC.arm();
//! // … 10 000 messages …
//! assert_eq!(ALLOC.disarm(), 0);
//! ```
#![expect(unsafe_code, reason = "GlobalAlloc is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

thread_local! {
    static EXEMPT: Cell<bool> = const { Cell::new(false) };
}

/// Leaves the calling thread out of the count, for good.
pub fn exempt_this_thread() {
    EXEMPT.with(|e| e.set(true));
}

/// The system allocator plus a counter of allocations and reallocations.
#[derive(Debug)]
pub struct CountingAllocator {
    armed: AtomicBool,
    count: AtomicU64,
    live: AtomicUsize,
}

impl Default for CountingAllocator {
    fn default() -> Self {
        Self::new()
    }
}

impl CountingAllocator {
    /// A disarmed counter.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            armed: AtomicBool::new(false),
            count: AtomicU64::new(0),
            live: AtomicUsize::new(0),
        }
    }

    /// Starts to count at zero.
    pub fn arm(&self) {
        self.count.store(0, Ordering::SeqCst);
        self.armed.store(true, Ordering::SeqCst);
    }

    /// Stops and returns how many allocations threads that are not exempt have made.
    pub fn disarm(&self) -> u64 {
        self.armed.store(false, Ordering::SeqCst);
        self.count.load(Ordering::SeqCst)
    }

    /// Bytes that are allocated now, by all threads, armed or not, as they were asked for.
    pub fn live(&self) -> usize {
        self.live.load(Ordering::Relaxed)
    }

    fn note(&self) {
        if self.armed.load(Ordering::Relaxed) && !EXEMPT.try_with(Cell::get).unwrap_or(true) {
            self.count.fetch_add(1, Ordering::Relaxed);
        }
    }
}

// SAFETY: every call goes to the system allocator unchanged; counting neither allocates nor
// unwinds (a const-initialised thread local without a destructor).
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        self.note();
        self.live.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's contract is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        self.live.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's contract is passed on.
        unsafe { System.dealloc(ptr, layout) }
    }

    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        self.note();
        self.live.fetch_add(new_size, Ordering::Relaxed);
        self.live.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's contract is passed on.
        unsafe { System.realloc(ptr, layout, new_size) }
    }
}
