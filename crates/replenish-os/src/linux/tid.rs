//! Kernel thread ids.
#![expect(unsafe_code, reason = "gettid")]

use crate::Tid;
use std::cell::Cell;

thread_local! {
    static CACHE: Cell<i32> = const { Cell::new(0) };
}

/// The id of the calling thread: `gettid()` once per thread, then a thread-local read.
///
/// The cache does not survive `fork` without `exec`: the child would read its parent's id.
#[inline]
#[must_use]
pub fn current_tid() -> Tid {
    match CACHE.with(Cell::get) {
        0 => ask(),
        known => Tid::known(known),
    }
}

#[cold]
fn ask() -> Tid {
    // SAFETY: gettid has no arguments, touches no memory and cannot fail.
    let tid = unsafe { libc::gettid() };
    CACHE.with(|cache| cache.set(tid));
    Tid::known(tid)
}

/// Whether `tid` is a thread of this process, as far as `/proc` says. Allocates.
pub(crate) fn is_of_this_process(tid: Tid) -> bool {
    std::path::Path::new(&format!("/proc/self/task/{tid}")).exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_stable_distinct_and_known_to_the_kernel() {
        let here = current_tid();
        assert_eq!(here, current_tid());
        let there = std::thread::spawn(current_tid).join().unwrap();
        assert_ne!(here, there);
        assert!(is_of_this_process(here));
        assert!(!is_of_this_process(there), "it has ended");
        assert!(!is_of_this_process(Tid::known(2)), "a thread of the kernel");
    }
}
