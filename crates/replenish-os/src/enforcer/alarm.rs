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

/// Time at which the timer is set to fire.
#[derive(Debug)]
pub(crate) struct Alarm(Nanos);

impl Alarm {
    /// A timer that is not set.
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

    /// When the timer fires, [`NEVER`] if it is not set.
    pub(crate) const fn time(&self) -> Nanos {
        self.0
    }

    /// The timer has fired and was read: it is not set any more.
    pub(crate) const fn fired(&mut self) {
        self.0 = NEVER;
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use core::cell::RefCell;

    #[test]
    fn it_is_set_earlier_alone_and_anew_once_it_has_fired_or_was_refused() {
        let mut alarm = Alarm::new();
        let armed = RefCell::new(alloc::vec::Vec::new());
        let arm = |at| {
            armed.borrow_mut().push(at);
            if at == 13 { Err(()) } else { Ok(()) }
        };
        for at in [100, 100, 150, 50] {
            alarm.set(at, arm).unwrap();
        }
        assert_eq!(*armed.borrow(), [100, 50]);
        alarm.set(13, arm).unwrap_err();
        alarm.set(40, arm).unwrap(); // not as late as one that counts as set at 13
        assert_eq!(*armed.borrow(), [100, 50, 13, 40]);
        alarm.fired();
        alarm.set(90, arm).unwrap();
        assert_eq!(*armed.borrow(), [100, 50, 13, 40, 90]);
    }
}
