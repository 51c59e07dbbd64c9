//! Messages of the enforcer that have no caller to return an error to.

use std::io::Write as _;

/// Reports a failure on standard error; a closed pipe there is no further failure.
pub(crate) fn complain(what: std::fmt::Arguments<'_>) {
    writeln!(std::io::stderr(), "replenish: {what}").ok();
}
