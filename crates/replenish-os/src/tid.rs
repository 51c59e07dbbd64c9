//! Numbers of threads.

use core::fmt;

/// The number of a thread: the kernel's (`gettid(2)`) on Linux, elsewhere one of ours. Never 0.
///
/// Linux and `NuttX` use it again after the thread has ended: keep a `Tid` no longer than something
/// else keeps the thread alive.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct Tid(i32);

impl Tid {
    /// The number `raw`, or `None` if it is not positive (Linux reads 0 as "the caller").
    #[must_use]
    pub const fn new(raw: i32) -> Option<Self> {
        if raw > 0 { Some(Self(raw)) } else { None }
    }

    /// The plain number.
    #[must_use]
    pub const fn get(self) -> i32 {
        self.0
    }

    /// An id that the back end knows to be positive.
    pub(crate) const fn known(raw: i32) -> Self {
        Self(raw)
    }
}

impl fmt::Display for Tid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_and_negative_ids_are_refused() {
        assert_eq!(Tid::new(0), None);
        assert_eq!(Tid::new(-1), None);
        assert_eq!(Tid::new(7).map(Tid::get), Some(7));
    }
}
