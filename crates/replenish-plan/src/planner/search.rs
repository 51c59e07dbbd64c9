//! Binary search for the largest number that holds.

/// The largest number between `good`, which is known to hold, and `bad`, which is known not to,
/// that holds.
pub(super) fn search(mut good: u64, mut bad: u64, mut holds: impl FnMut(u64) -> bool) -> u64 {
    while bad - good > 1 {
        let middle = good + (bad - good) / 2;
        if holds(middle) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    good
}
