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
    /// Also write the result to this file, as JSON.
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

/// `--last 5s`: a whole number of seconds or milliseconds, with its unit.
///
/// # Errors
/// The allowed form.
pub fn last(text: &str) -> Result<Nanos, String> {
    let number = |digits: &str, unit: Nanos| {
        let n = digits.parse::<u64>().ok().filter(|n| *n > 0);
        n.and_then(|n| n.checked_mul(unit))
    };
    let time = match text.strip_suffix("ms") {
        Some(ms) => number(ms, MS),
        None => text.strip_suffix('s').and_then(|s| number(s, 1000 * MS)),
    };
    time.ok_or_else(|| "allowed is a whole number above 0 with its unit: 5s, 200ms".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_a_unit() {
        assert_eq!(last("5s"), Ok(5_000 * MS));
        assert_eq!(last("200ms"), Ok(200 * MS));
        for wrong in ["5", "0s", "-1s", "s", "1.5s", "99999999999999999999s"] {
            assert!(last(wrong).is_err(), "{wrong}");
        }
    }
}
