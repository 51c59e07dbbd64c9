//! What stands in for `std::io::Error`: a fixed text.

use core::fmt;

/// Why an operation was refused.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct OsError(pub(crate) &'static str);

impl fmt::Display for OsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
}

impl core::error::Error for OsError {}
