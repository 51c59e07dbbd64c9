//! Option groups and value ranges that several commands share.
//!
//! Ranges are checked by clap, whose messages name the option and the range.

use crate::time::{MS, Nanos};
use clap::Args;
use clap::builder::RangedU64ValueParser;
use std::path::PathBuf;

/// `--json PATH`, on every command.
#[derive(Debug, Clone, Args)]
pub struct JsonOption {
    /// Also write the result to this file, as JSON
    #[arg(long, value_name = "PATH")]
    pub json: Option<PathBuf>,
}

/// Periods of budgets: long enough to enforce, short enough for the RT throttle (95 % of 1 s).
pub fn period() -> RangedU64ValueParser {
    clap::value_parser!(u64).range(2..=900)
}

/// Milliseconds of an option in nanoseconds.
pub fn ms(value: u64) -> Nanos {
    value.saturating_mul(MS)
}
