//! Deadlines of callbacks: their judgement, and the consequences of a miss.

use super::state::HandleState;
use crate::Nanos;
use crate::executor::wake::stop::StopHandle;
use crate::platform::recorder;
use alloc::boxed::Box;
use core::fmt;

/// The time from a callback's release to its latest end.
#[derive(Clone, Copy)]
pub(crate) struct Deadline {
    pub(crate) within: Nanos,
    /// The judgement. Programs without deadlines do not carry its code, since it is reached from
    /// here.
    judge: Judge,
}

/// The callback that has ended: its release, and the time from there to its end.
#[derive(Clone, Copy)]
pub(crate) struct Ended {
    pub(crate) due: Nanos,
    pub(crate) response: Nanos,
}

/// Whether the handle's next input is left out.
type Judge = fn(Nanos, Ended, &HandleState, &mut OnMiss, &StopHandle) -> bool;

impl Deadline {
    pub(crate) fn of(within: Nanos) -> Self {
        Self { within, judge }
    }

    /// Counts a miss and carries out its consequence. `true`: the next input is left out.
    pub(crate) fn judge(
        &self,
        ended: Ended,
        state: &HandleState,
        on_miss: &mut OnMiss,
        stop: &StopHandle,
    ) -> bool {
        (self.judge)(self.within, ended, state, on_miss, stop)
    }
}

fn judge(
    within: Nanos,
    ended: Ended,
    state: &HandleState,
    on_miss: &mut OnMiss,
    stop: &StopHandle,
) -> bool {
    let lateness = ended.response.saturating_sub(within);
    if lateness == 0 {
        return false;
    }
    let count = state.counters.deadline_misses.add(1);
    state.counters.worst_lateness.raise(lateness);
    let end = ended.due.saturating_add(ended.response);
    recorder::miss(state.name, end, lateness, within);
    let miss = DeadlineMiss {
        id: &state.id,
        due: ended.due,
        deadline: within,
        lateness,
        count,
    };
    match on_miss {
        OnMiss::Count => {}
        OnMiss::SkipNext => return true,
        OnMiss::Stop => stop.stop(),
        OnMiss::Call(handler) => handler(&miss),
    }
    false
}

impl fmt::Debug for Deadline {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.within.fmt(f)
    }
}

/// The consequence of a callback that ends after its deadline. The miss is always counted.
#[derive(Default)]
#[non_exhaustive]
pub enum OnMiss {
    /// The miss has no further consequence.
    #[default]
    Count,
    /// The next input of the handle is taken and left out, so that it can catch up. Replies and the
    /// wake-ups of a future that is not done are never left out: somebody waits for them.
    SkipNext,
    /// The executor stops.
    Stop,
    /// The worker calls this function.
    Call(Box<dyn FnMut(&DeadlineMiss<'_>) + Send>),
}

impl fmt::Debug for OnMiss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Count => "Count",
            Self::SkipNext => "SkipNext",
            Self::Stop => "Stop",
            Self::Call(_) => "Call",
        })
    }
}

/// A callback that ended too late. Times in nanoseconds, instants of `CLOCK_MONOTONIC`.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct DeadlineMiss<'a> {
    /// The handle.
    pub id: &'a str,
    /// The release: the sample's arrival, the timer's release.
    pub due: Nanos,
    /// The deadline, counted from the release.
    pub deadline: Nanos,
    /// Time from the deadline to the end of the callback.
    pub lateness: Nanos,
    /// Number of deadlines that this handle has missed so far.
    pub count: u64,
}
