//! One-shot timers: one task blocks in [`TimerFd::read`], any task arms.

use super::critical_section::{CriticalSection, Guarded};
use super::error::OsError;
use crate::Nanos;
use crate::backend::port;
use crate::backend::port::alarm;
use crate::backend::port::task_slot::{self, NEVER, TaskSlot};

/// A one-shot timer on [`monotonic`](super::clock::monotonic) time. The name is that of Linux;
/// there is no descriptor. Arming it while a task reads moves that task's deadline and switches
/// nothing.
#[derive(Debug)]
pub struct TimerFd(Guarded<TimerState>);

struct TimerState {
    at: Nanos,
    reader: Option<&'static TaskSlot>,
    /// The task that read last.
    owner: Option<&'static TaskSlot>,
}

impl TimerFd {
    /// A disarmed timer.
    ///
    /// # Errors
    /// None; as on Linux.
    pub fn new() -> Result<Self, OsError> {
        Ok(Self(Guarded::new(TimerState {
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
            let section = CriticalSection::enter();
            let cs = section.token();
            let fired = self.0.within(cs, |timer| {
                timer.owner = Some(me);
                let fired = me.state.within(cs, task_slot::TaskState::take_reached);
                let fired = fired || timer.at <= port::board_now();
                if fired {
                    timer.at = NEVER;
                    timer.reader = None;
                } else {
                    timer.reader = Some(me);
                    me.state.within(cs, |s| s.deadline = timer.at);
                    alarm::program(timer.at, cs);
                }
                fired
            });
            drop(section);
            if fired {
                return Ok(());
            }
            port::block();
        }
    }

    /// The task that reads.
    pub(crate) fn owner(&self) -> Option<&'static TaskSlot> {
        self.0.with(|timer| timer.owner)
    }

    fn set(&self, at: Nanos) {
        let section = CriticalSection::enter();
        let cs = section.token();
        self.0.within(cs, |timer| {
            timer.at = at;
            if let Some(reader) = timer.reader {
                reader.state.within(cs, |s| s.deadline = at);
                alarm::program(at, cs);
            }
        });
    }
}
