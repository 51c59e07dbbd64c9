//! What a callback gets besides its message, and what it may return.

use super::stop::StopHandle;
use crate::Nanos;
use core::fmt;

/// Facts about the callback that runs, and the way to stop the executor from inside it.
#[derive(Debug)]
pub struct CallbackContext<'a> {
    pub(crate) id: &'a str,
    pub(crate) worker: &'a str,
    pub(crate) due: Nanos,
    pub(crate) started: Nanos,
    pub(crate) skipped: u64,
    pub(crate) stop: &'a StopHandle,
}

impl CallbackContext<'_> {
    /// The handle's id: `/node/sub:/topic`, `worker/timer:0`.
    #[must_use]
    pub fn id(&self) -> &str {
        self.id
    }

    /// The worker's name.
    #[must_use]
    pub fn worker(&self) -> &str {
        self.worker
    }

    /// When the sample reached this process, or the timer's release (`CLOCK_MONOTONIC`).
    #[must_use]
    pub fn due(&self) -> Nanos {
        self.due
    }

    /// When the callback started (`CLOCK_MONOTONIC`).
    #[must_use]
    pub fn started(&self) -> Nanos {
        self.started
    }

    /// Timers: releases left out since the previous callback because they were overrun.
    #[must_use]
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Asks the executor to stop. Returns at once; nothing new starts after this callback.
    pub fn stop(&self) {
        self.stop.stop();
    }

    /// Whether the executor has been asked to stop: a long callback should look now and then.
    #[must_use]
    pub fn is_stopping(&self) -> bool {
        self.stop.is_stopping()
    }
}

/// What a callback may return: nothing, or a `Result` whose error is counted and reported.
///
/// An error never ends the executor and never stops the handle.
pub trait CallbackResult {
    /// Calls `report` with the error, if there is one.
    fn inspect(self, report: &mut dyn FnMut(&dyn fmt::Display));
}

impl CallbackResult for () {
    fn inspect(self, _report: &mut dyn FnMut(&dyn fmt::Display)) {}
}

impl<E: fmt::Display> CallbackResult for Result<(), E> {
    fn inspect(self, report: &mut dyn FnMut(&dyn fmt::Display)) {
        if let Err(e) = self {
            report(&e);
        }
    }
}
