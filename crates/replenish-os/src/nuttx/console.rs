//! Lines on standard error of the image.

use super::ffi;
use core::fmt::{self, Write as _};

/// Reports a failure that has no caller to return an error to.
pub(crate) fn complain(what: fmt::Arguments<'_>) {
    struct Console;
    impl fmt::Write for Console {
        fn write_str(&mut self, s: &str) -> fmt::Result {
            ffi::print(s);
            Ok(())
        }
    }
    // The console has no error to report.
    writeln!(Console, "replenish: {what}").ok();
}
