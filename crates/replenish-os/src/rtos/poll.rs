//! Waking the task that waits for the middleware: a flag in place of descriptors.

use super::error::OsError;
use crate::{Nanos, Notify};

/// Wakes the one task that waits in [`wait_until`](Self::wait_until). Any task or interrupt, any
/// number of times; several wake-ups before a wait count once.
#[derive(Debug)]
pub struct WakeFd(Notify);

impl WakeFd {
    /// A wake-up that is not set.
    ///
    /// # Errors
    /// None; as on Linux.
    pub fn new() -> Result<Self, OsError> {
        Ok(Self(Notify::new()))
    }

    /// A wake-up that is not set, for statics.
    #[must_use]
    pub const fn constant() -> Self {
        Self(Notify::new())
    }

    /// Ends the wait, now or the next one. Never waits; allowed in interrupts.
    pub fn wake(&self) {
        self.0.set();
    }

    /// Takes back all wake-ups so far; returns whether there was one. Never waits.
    pub fn clear(&self) -> bool {
        self.0.take()
    }

    /// Waits for a wake-up, at most until `deadline` (`None`: for ever). Whether one came; it is
    /// consumed.
    pub fn wait_until(&self, deadline: Option<Nanos>) -> bool {
        match deadline {
            Some(t) => self.0.wait_until(t),
            None => {
                self.0.wait();
                true
            }
        }
    }
}
