//! In the place of `origins` without feature `sample-info`: no sample knows its causes.

/// Chains that one callback can be in.
pub const MOST_CHAINS: usize = 0;

/// Nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Origins(());

impl Origins {
    /// Of every sample.
    pub const NONE: Self = Self(());
}
