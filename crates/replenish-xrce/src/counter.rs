//! Counters of events.

/// Counts one more; out of line where flash is scarce.
#[cfg_attr(not(feature = "std"), inline(never))]
pub(crate) const fn count(counter: &mut u64) {
    count_all(counter, 1);
}

/// Counts one more in place, where each message comes by.
#[inline(always)]
pub(crate) const fn count_inline(counter: &mut u64) {
    *counter = counter.wrapping_add(1); // 2^64 messages take centuries
}

/// Counts `more`.
#[cfg_attr(not(feature = "std"), inline(never))]
pub(crate) const fn count_all(counter: &mut u64, more: usize) {
    *counter = counter.saturating_add(more as u64);
}
