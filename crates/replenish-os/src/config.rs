//! The error of a setting that is out of its range, for the crates that open sockets and threads
//! from a configuration.

use std::fmt::{self, Display};
use std::ops::RangeInclusive;

/// A setting is out of its range.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigError {
    /// The setting, as in the code: `limits.clients`.
    pub field: &'static str,
    /// The refused value.
    pub value: String,
    /// The values that the setting can have.
    pub allowed: String,
}

impl Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (value, allowed) = (&self.value, &self.allowed);
        write!(f, "{} is {value}, allowed is {allowed}", self.field)
    }
}

impl std::error::Error for ConfigError {}

/// Checks that `value` is in `range`.
///
/// # Errors
/// Names the field, the value and the range.
pub fn within<T: PartialOrd + Display + Copy>(
    field: &'static str,
    value: T,
    range: RangeInclusive<T>,
) -> Result<(), ConfigError> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(ConfigError {
        field,
        value: value.to_string(),
        allowed: format!("{} to {}", range.start(), range.end()),
    })
}
