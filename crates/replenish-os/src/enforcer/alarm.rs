//! The one timer of an enforcer, as those who share its lock know it.
//!
//! ```text
//!   armed = NEVER ── set(at) ──► armed = at ── set(earlier) ──► armed = earlier
//!        ▲                            │ set(later): nothing, the reader sets it again
//!        └────── fired(), by the reader, with the lock in its hands
//! ```
//!
//! The timer is set earlier, never later: so no expiry is forgotten that was not read yet.
//! `modelled/loom_alarm.rs` tries every interleaving.

use super::config::NEVER;
use crate::Nanos;

/// When the timer is set to fire.
#[derive(Debug)]
pub(crate) struct Alarm(Nanos);

impl Alarm {
    /// Of a timer that is not set.
    pub(crate) const fn new() -> Self {
        Self(NEVER)
    }

    /// Makes sure that the timer fires at `at` or earlier; `arm` sets it.
    ///
    /// # Errors
    /// That of `arm`. The timer counts as not set then, and the next one tries again.
    pub(crate) fn set<E>(
        &mut self,
        at: Nanos,
        arm: impl FnOnce(Nanos) -> Result<(), E>,
    ) -> Result<(), E> {
        if at < self.0 {
            arm(at)?;
            self.0 = at;
        }
        Ok(())
    }

    /// The timer has fired and was read: it is not set any more.
    pub(crate) const fn fired(&mut self) {
        self.0 = NEVER;
    }
}
