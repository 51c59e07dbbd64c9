//! Kernel thread ids.
#![expect(unsafe_code, reason = "gettid")]

use std::cell::Cell;
use std::fmt;

/// A kernel thread id, as `gettid(2)` gives it. Never 0.
///
/// The kernel uses the number again after the thread has ended: keep a `Tid` no longer than
/// something else keeps the thread alive.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct Tid(i32);

impl Tid {
    /// The id `raw`, or `None` if it is not positive (the kernel reads 0 as "the caller").
    #[must_use]
    pub const fn new(raw: i32) -> Option<Self> {
        if raw > 0 { Some(Self(raw)) } else { None }
    }

    /// The number the kernel knows.
    #[must_use]
    pub const fn get(self) -> i32 {
        self.0
    }
}

impl fmt::Display for Tid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

thread_local! {
    static CACHE: Cell<i32> = const { Cell::new(0) };
}

/// The id of the calling thread: `gettid()` once per thread, then a thread-local read.
///
/// The cache does not survive `fork` without `exec`: the child would read its parent's id.
#[must_use]
pub fn current_tid() -> Tid {
    CACHE.with(|cache| {
        if cache.get() == 0 {
            // SAFETY: gettid has no arguments, touches no memory and cannot fail.
            cache.set(unsafe { libc::gettid() });
        }
        Tid(cache.get())
    })
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
        assert!(std::path::Path::new(&format!("/proc/self/task/{here}")).exists());
    }

    #[test]
    fn zero_and_negative_ids_are_refused() {
        assert_eq!(Tid::new(0), None);
        assert_eq!(Tid::new(-1), None);
        assert_eq!(Tid::new(7).map(Tid::get), Some(7));
    }
}
