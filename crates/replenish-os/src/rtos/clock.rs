//! Clocks: the board's monotonic time, and CPU time of tasks, exact to the switch.

use super::futex;
use super::tid::current_tid;
use crate::Nanos;
use crate::Tid;
use crate::backend::port;
use crate::backend::port::task_slot::{self, TaskSlot};

/// Nanoseconds since the board started, by a hardware timer of the image. Any task or interrupt;
/// never goes back.
#[must_use]
pub fn monotonic() -> Nanos {
    port::board_now()
}

/// CPU time of the calling task in nanoseconds, interrupts that came meanwhile included.
#[must_use]
pub fn thread_cpu() -> Nanos {
    let now = port::board_now();
    task_slot::current().map_or(0, |slot| slot.state.with(|s| s.cpu(now)))
}

/// The CPU clock of one task; any task may read it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ThreadCpuClock(Tid);

impl ThreadCpuClock {
    /// The clock of the calling task, to be read by others.
    #[must_use]
    pub fn current() -> Self {
        Self(current_tid())
    }

    /// The clock of task `tid`.
    #[must_use]
    pub const fn of(tid: Tid) -> Self {
        Self(tid)
    }

    /// CPU time consumed by the task so far; `None` once its function has returned.
    #[must_use]
    pub fn read(&self) -> Option<Nanos> {
        self.read_at(port::board_now())
    }

    /// The same, for a caller that has the time at hand.
    pub(crate) fn read_at(&self, now: Nanos) -> Option<Nanos> {
        let slot: &TaskSlot = task_slot::find(self.0.get())?;
        slot.state.with(|s| (!s.ended).then(|| s.cpu(now)))
    }
}

/// Sleeps until [`monotonic`] has reached `t`; returns at once if it has.
pub fn sleep_until(t: Nanos) {
    futex::sleep_until(t);
}
