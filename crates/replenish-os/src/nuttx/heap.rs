//! The system's heap as Rust's, which can be sealed when everything is made.
#![expect(unsafe_code, reason = "a global allocator")]

use super::console::complain;
use super::ffi;
use core::alloc::{GlobalAlloc, Layout};
use core::ptr;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// `malloc` and `free` of the image, for `#[global_allocator]`. Sealed, it reports and refuses
/// every further allocation of this library; the rest of the image goes on.
#[derive(Debug, Default)]
pub struct SystemHeap {
    sealed: AtomicBool,
    refused: AtomicU32,
}

impl SystemHeap {
    /// The heap, open.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            sealed: AtomicBool::new(false),
            refused: AtomicU32::new(0),
        }
    }

    /// From now on every allocation fails.
    pub fn seal(&self) {
        self.sealed.store(true, Ordering::Release);
    }

    /// Allocations that were asked for after [`seal`](Self::seal), and refused.
    #[must_use]
    pub fn refused(&self) -> u32 {
        self.refused.load(Ordering::Acquire)
    }
}

// SAFETY: the image's allocator, which may be called from any thread.
unsafe impl GlobalAlloc for SystemHeap {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if self.sealed.load(Ordering::Acquire) {
            self.refused.fetch_add(1, Ordering::AcqRel);
            let bytes = layout.size();
            complain(format_args!("the heap is sealed: {bytes} bytes refused"));
            return ptr::null_mut();
        }
        ffi::malloc(layout.align(), layout.size())
    }

    unsafe fn dealloc(&self, block: *mut u8, _: Layout) {
        // SAFETY: the caller's word: from `alloc`, and not used again.
        unsafe { ffi::free(block) };
    }
}
