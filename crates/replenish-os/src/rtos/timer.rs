//! One-shot timers: one task blocks in [`TimerFd::read`], any task arms.

use super::alarm;
use super::critical_section::{Mask, Masked};
use super::error::OsError;
use super::ffi;
use super::task_slot::{self, NEVER, Slot};
use crate::Nanos;

/// A one-shot timer on [`monotonic`](super::clock::monotonic) time. The name is that of Linux; there
/// is no descriptor. Arming it while a task reads moves that task's deadline and switches nothing.
#[derive(Debug)]
pub struct TimerFd(Masked<Inner>);

struct Inner {
    at: Nanos,
    reader: Option<&'static Slot>,
    /// Who read last.
    owner: Option<&'static Slot>,
}

impl TimerFd {
    /// A disarmed timer.
    ///
    /// # Errors
    /// None; as on Linux.
    pub fn new() -> Result<Self, OsError> {
        Ok(Self(Masked::new(Inner {
            at: NEVER,
            reader: None,
            owner: None,
        })))
    }

    /// Fires once at the absolute time `t`, or at once if `t` has passed. Replaces what was armed.
    ///
    /// # Errors
    /// None; as on Linux.
    pub fn arm(&self, t: Nanos) -> Result<(), OsError> {
        self.set(t);
        Ok(())
    }

    /// Stops the timer.
    ///
    /// # Errors
    /// None; as on Linux.
    pub fn disarm(&self) -> Result<(), OsError> {
        self.set(NEVER);
        Ok(())
    }

    /// Waits until the timer fires and consumes the expiry. One task at a time.
    ///
    /// # Errors
    /// If called outside of a task.
    pub fn read(&self) -> Result<(), OsError> {
        let me = task_slot::current().ok_or(OsError::new("a timer was read outside of a task"))?;
        loop {
            let mask = Mask::set();
            let quiet = mask.quiet();
            let fired = self.0.within(quiet, |inner| {
                inner.owner = Some(me);
                let fired = me.state.within(quiet, task_slot::State::take_reached);
                let fired = fired || inner.at <= ffi::board_now();
                if fired {
                    inner.at = NEVER;
                    inner.reader = None;
                } else {
                    inner.reader = Some(me);
                    me.state.within(quiet, |s| s.deadline = inner.at);
                    alarm::program(inner.at, quiet);
                }
                fired
            });
            drop(mask);
            if fired {
                return Ok(());
            }
            ffi::block();
        }
    }

    /// The task that reads.
    pub(crate) fn owner(&self) -> Option<&'static Slot> {
        self.0.with(|inner| inner.owner)
    }

    fn set(&self, at: Nanos) {
        let mask = Mask::set();
        let quiet = mask.quiet();
        self.0.within(quiet, |inner| {
            inner.at = at;
            if let Some(reader) = inner.reader {
                reader.state.within(quiet, |s| s.deadline = at);
                alarm::program(at, quiet);
            }
        });
    }
}
