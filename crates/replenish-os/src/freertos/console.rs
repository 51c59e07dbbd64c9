//! Lines on the image's console, with and without formatting.
//!
//! Formatting takes kilobytes of code, so an image that does not panic in words avoids it.

use super::ffi::print;
use core::fmt::{self, Write as _};

/// The beginning of every line.
pub(super) const PREFIX: &[u8] = b"replenish: ";

/// Reports a failure of the enforcer, which never has arguments here: the kernel's timers cannot
/// fail.
pub(crate) fn complain(what: fmt::Arguments<'_>) {
    let what = what.as_str().unwrap_or("the enforcer failed");
    for part in [PREFIX, what.as_bytes(), b"\n"] {
        print(part);
    }
}

/// Writes a formatted line, for callers that contain the code for formatting anyway.
pub(super) fn print_formatted(what: fmt::Arguments<'_>) {
    struct Console;
    impl fmt::Write for Console {
        fn write_str(&mut self, s: &str) -> fmt::Result {
            print(s.as_bytes());
            Ok(())
        }
    }
    // The console has no error to report.
    writeln!(Console, "replenish: {what}").ok();
}

/// Writes a number without formatting.
pub(super) fn print_decimal(number: usize) {
    if number >= 10 {
        print_decimal(number / 10);
    }
    print(&[b'0' + u8::try_from(number % 10).unwrap_or(0)]);
}
