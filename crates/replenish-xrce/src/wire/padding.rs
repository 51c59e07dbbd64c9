//! Alignment.

/// Bytes from `pos` to the next multiple of `to`, a power of two.
pub(crate) const fn padding(pos: usize, to: usize) -> usize {
    pos.wrapping_neg() & to.wrapping_sub(1)
}
