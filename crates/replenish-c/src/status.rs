//! Codes of the interface, and the text of a thread's last error.
#![allow(
    clippy::doc_markdown,
    reason = "documentation here is that of the C header"
)]

use replenish_threads::{Failure, Why};
use std::cell::RefCell;
use std::ffi::{CStr, CString};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// The version of this header: major, minor and patch in two, one and one byte.
pub const REPLENISH_VERSION: u32 = 0x100;

/// Done.
pub const REPLENISH_OK: i32 = 0;
/// An argument is null or out of its range; the text names it and the range.
pub const REPLENISH_INVALID: i32 = 1;
/// The guarantee does not fit beside the others; the text says why, and what would fit.
pub const REPLENISH_REFUSED: i32 = 2;
/// A privilege is missing; the text says how to grant it.
pub const REPLENISH_NOT_PERMITTED: i32 = 3;
/// There is no such budget, or no such thread in this process; or neither the program nor the
/// deployment file says how large the budget is.
pub const REPLENISH_NOT_FOUND: i32 = 4;
/// The thread has a budget already.
pub const REPLENISH_BUSY: i32 = 5;
/// No room is left: 64 budgets on a CPU, 64 threads in a budget.
pub const REPLENISH_FULL: i32 = 6;
/// This library or this system cannot do it.
pub const REPLENISH_UNSUPPORTED: i32 = 7;
/// The system refused something; the text says what.
pub const REPLENISH_SYSTEM: i32 = 8;
/// A fault of the library. Nothing was unwound into the caller.
pub const REPLENISH_INTERNAL: i32 = 9;
/// The process is a fork of the one that made the budgets: it has none, and can make none.
pub const REPLENISH_FORKED: i32 = 10;

pub(crate) fn code(why: Why) -> i32 {
    match why {
        Why::Invalid => REPLENISH_INVALID,
        Why::Refused => REPLENISH_REFUSED,
        Why::NotPermitted => REPLENISH_NOT_PERMITTED,
        Why::NotFound => REPLENISH_NOT_FOUND,
        Why::Busy => REPLENISH_BUSY,
        Why::Full => REPLENISH_FULL,
        Why::Unsupported => REPLENISH_UNSUPPORTED,
        Why::Forked => REPLENISH_FORKED,
        _ => REPLENISH_SYSTEM,
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Runs `body` at the edge: a panic ends here, a failure leaves its text for the thread.
pub(crate) fn at_edge(body: impl FnOnce() -> Result<(), Failure>) -> i32 {
    let (code, text) = match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => return REPLENISH_OK,
        Ok(Err(failure)) => (code(failure.why), failure.text),
        Err(_) => (
            REPLENISH_INTERNAL,
            "a fault of libreplenish, please report it: the message stands on standard error"
                .to_owned(),
        ),
    };
    let mut bytes = text.into_bytes();
    bytes.retain(|byte| *byte != 0);
    let text = CString::new(bytes).unwrap_or_default();
    // A thread that is ending keeps no text.
    LAST.try_with(|last| last.replace(text)).ok();
    code
}

/// Calls `with` with the text of the thread's last error; `None` in a thread that is ending.
pub(crate) fn last_error<T>(with: impl FnOnce(&CStr) -> T) -> Option<T> {
    LAST.try_with(|last| with(&last.borrow())).ok()
}

/// The name of a code.
pub(crate) fn name(code: i32) -> &'static CStr {
    match code {
        REPLENISH_OK => c"ok",
        REPLENISH_INVALID => c"invalid argument",
        REPLENISH_REFUSED => c"guarantee refused",
        REPLENISH_NOT_PERMITTED => c"privilege missing",
        REPLENISH_NOT_FOUND => c"not found",
        REPLENISH_BUSY => c"thread has a budget already",
        REPLENISH_FULL => c"no room left",
        REPLENISH_UNSUPPORTED => c"not supported",
        REPLENISH_SYSTEM => c"refused by the system",
        REPLENISH_INTERNAL => c"fault of the library",
        REPLENISH_FORKED => c"not after fork",
        _ => c"unknown code",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_is_the_packages() {
        let part = |text: &str| text.parse::<u32>().unwrap();
        let (major, minor, patch) = (
            part(env!("CARGO_PKG_VERSION_MAJOR")),
            part(env!("CARGO_PKG_VERSION_MINOR")),
            part(env!("CARGO_PKG_VERSION_PATCH")),
        );
        assert_eq!(REPLENISH_VERSION, major << 16 | minor << 8 | patch);
    }

    #[test]
    fn a_panic_ends_at_the_edge() {
        assert_eq!(at_edge(|| panic!("on purpose")), REPLENISH_INTERNAL);
        let text = last_error(|text| text.to_string_lossy().into_owned()).unwrap();
        assert!(text.contains("libreplenish"), "{text}");
    }

    #[test]
    fn a_text_is_the_threads_own_and_has_no_end_inside() {
        let fails = || at_edge(|| Err(Failure::invalid("a\0b")));
        assert_eq!(fails(), REPLENISH_INVALID);
        assert_eq!(last_error(CStr::to_owned).unwrap().as_c_str(), c"ab");
        let elsewhere = std::thread::spawn(|| last_error(CStr::to_owned).unwrap());
        assert_eq!(elsewhere.join().unwrap().as_c_str(), c"");
    }
}
