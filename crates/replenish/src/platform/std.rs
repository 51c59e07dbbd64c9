//! Parts of the standard library. `std_disabled.rs` takes this file's place without feature `std`.

pub(crate) mod chain;
pub(crate) mod local;
pub(crate) mod recorder;
pub(crate) mod sleeping;
pub(crate) mod source_set;

use core::any::Any;
use core::cell::RefCell;
use core::time::Duration;
use replenish_os::Account;
use std::boxed::Box;
use std::hash::{BuildHasher, RandomState};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::string::String;
use std::time::{SystemTime, UNIX_EPOCH};

pub(crate) use replenish_rtps::promise::{Deadline, Lease};
#[allow(unreachable_pub, reason = "public as middleware::xrce::io")]
pub use std::io;

/// The wall clock: time since 1970 in UTC; `None` where it is set before that.
pub(crate) fn wall_clock() -> Option<Duration> {
    SystemTime::now().duration_since(UNIX_EPOCH).ok()
}

/// Random bits: keyed by the operating system, once per thread and then counted on.
pub(crate) fn random(salt: u64) -> u64 {
    let now = replenish_os::clock::monotonic();
    RandomState::new().hash_one((salt, std::process::id(), now))
}

/// Runs `step` on `subject`. If it panics, gives `panicked` the subject and the message.
pub(crate) fn guard<S: ?Sized, T>(
    subject: &mut S,
    step: impl FnOnce(&mut S) -> T,
    panicked: impl FnOnce(&mut S, &str) -> T,
) -> T {
    match catch_unwind(AssertUnwindSafe(|| step(subject))) {
        Ok(result) => result,
        Err(panic) => recover(panic, |message| panicked(subject, message)),
    }
}

#[cold]
fn recover<T>(panic: Box<dyn Any + Send>, panicked: impl FnOnce(&str) -> T) -> T {
    let message = match (panic.downcast_ref::<&str>(), panic.downcast_ref::<String>()) {
        (Some(s), _) => s,
        (None, Some(s)) => s.as_str(),
        (None, None) => "(no message)",
    };
    let result = panicked(message);
    core::mem::forget(panic); // dropping a payload may panic again
    result
}

thread_local! {
    static ACCOUNT: RefCell<Option<Account>> = const { RefCell::new(None) };
}

/// Before the thread runs callbacks: what they put into thread locals is dropped before an account
/// that [ends](end_with) with the thread, since it comes later.
pub(crate) fn prepare_end() {
    ACCOUNT.with(|_| ());
}

/// Holds the thread to its budget until it has dropped everything else.
pub(crate) fn end_with(account: Account) {
    ACCOUNT.with(|last| last.replace(Some(account)));
}

/// Prints an event as one line on standard error: the default for events.
pub(crate) fn tell(event: &dyn core::fmt::Display) {
    // A closed pipe as standard error is no reason to fail: the line is lost.
    io::Write::write_fmt(&mut io::stderr(), format_args!("replenish: {event}\n")).ok();
}
