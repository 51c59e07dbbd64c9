//! SIGINT and SIGTERM as a flag and a wake-up: every command ends cleanly on them.

use crate::outcome::Failure;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// "Please end": set by a signal, or by whoever supervises this process.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stop(Arc<(Mutex<bool>, Condvar)>);

impl Stop {
    /// A stop that SIGINT and SIGTERM trigger.
    pub(crate) fn on_signals() -> Result<Self, Failure> {
        let stop = Self::default();
        let mut signals = Signals::new([SIGINT, SIGTERM])
            .map_err(|e| Failure::refused(format!("cannot handle signals: {e}")))?;
        let trigger = stop.clone();
        std::thread::spawn(move || {
            for _ in signals.forever() {
                trigger.trigger();
            }
        });
        Ok(stop)
    }

    /// Asks for the end.
    pub(crate) fn trigger(&self) {
        *self.0.0.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.0.1.notify_all();
    }

    /// Whether the end was asked for.
    pub(crate) fn is_triggered(&self) -> bool {
        *self.0.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until the end is asked for.
    pub(crate) fn wait_forever(&self) {
        while !self.wait(Duration::from_secs(3_600)) {}
    }

    /// Waits until the end is asked for, at most `limit`; returns whether it was.
    pub(crate) fn wait(&self, limit: Duration) -> bool {
        let guard = self.0.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (guard, _) = self
            .0
            .1
            .wait_timeout_while(guard, limit, |stop| !*stop)
            .unwrap_or_else(PoisonError::into_inner);
        *guard
    }
}
