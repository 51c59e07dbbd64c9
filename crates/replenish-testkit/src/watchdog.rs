//! Ends a test process that hangs: a dead-locked real-time test must not hold up CI for an hour.

use std::sync::mpsc;
use std::time::Duration;

/// Guards one piece of work; dropping it in time calls the dog off.
#[derive(Debug)]
pub struct Watchdog(
    #[expect(dead_code, reason = "dropping it disconnects the channel")] mpsc::Sender<()>,
);

/// Aborts the process with a message that names `what` unless the guard is dropped in time.
#[must_use]
pub fn watchdog(what: &'static str, limit: Duration) -> Watchdog {
    let (tx, rx) = mpsc::channel::<()>();
    std::thread::spawn(move || {
        crate::alloc::exempt_this_thread(); // its first wait allocates
        if rx.recv_timeout(limit) == Err(mpsc::RecvTimeoutError::Timeout) {
            eprintln!("watchdog: {what} did not end within {limit:?}; aborting");
            std::process::abort();
        }
    });
    Watchdog(tx)
}
