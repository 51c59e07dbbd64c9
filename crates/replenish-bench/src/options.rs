//! Value ranges that several commands of the laboratory share.
//!
//! Ranges are checked by clap, whose messages name the option and the range.

use clap::builder::RangedU64ValueParser;
pub(crate) use replenish_cli::options::{ms, period};

/// Budgets; that they do not exceed the period is checked where both are known.
pub(crate) fn budget() -> RangedU64ValueParser {
    clap::value_parser!(u64).range(1..=900)
}

/// Numbers of windows.
pub(crate) fn windows() -> RangedU64ValueParser {
    clap::value_parser!(u64).range(1..=10_000)
}
