//! Option groups and value ranges that several commands share.
//!
//! Ranges are checked by clap, whose messages name the option and the range.

use crate::load::{MS, Nanos};
use clap::Args;
use clap::builder::RangedU64ValueParser;
use std::path::PathBuf;

/// `--json PATH`, on every command.
#[derive(Debug, Clone, Args)]
pub(crate) struct JsonOption {
    /// Also write the result to this file, as JSON
    #[arg(long, value_name = "PATH")]
    pub json: Option<PathBuf>,
}

/// Periods of budgets: long enough to enforce, short enough for the RT throttle (95 % of 1 s).
pub(crate) fn period() -> RangedU64ValueParser {
    clap::value_parser!(u64).range(2..=900)
}

/// Budgets; that they do not exceed the period is checked where both are known.
pub(crate) fn budget() -> RangedU64ValueParser {
    clap::value_parser!(u64).range(1..=900)
}

/// Numbers of windows.
pub(crate) fn windows() -> RangedU64ValueParser {
    clap::value_parser!(u64).range(1..=10_000)
}

/// Milliseconds of an option in nanoseconds.
pub(crate) fn ms(value: u64) -> Nanos {
    value.saturating_mul(MS)
}
