//! How a worker goes through its handles: what starts a round, what a round takes, and what
//! happens to a handle whose deadline was missed.

#[cfg(feature = "texts")]
use super::round_stats::RoundCounters;
use super::rounds::{BY_RULES, Rounds};
use crate::Nanos;
use crate::event::Event;
use crate::executor::handles::entry::HandleEntry;
use crate::executor::handles::group::Group;
use crate::executor::handles::handle::Deadline;
use crate::executor::wake::schedule::{Every, nanos};
#[cfg(feature = "texts")]
use crate::sync::Arc;
use alloc::boxed::Box;
use alloc::string::String;
use core::fmt;
use core::time::Duration;

/// What must be there for a worker to begin a round. It is looked at when something new has come
/// (a sample, a release, a trigger), never in a loop: input that waits for the rest costs nothing.
///
/// ```
/// use replenish::Trigger;
/// let both = Trigger::All;
/// let either = Trigger::custom(|handles| {
///     handles.is_ready("/n/sub:/left") || handles.is_ready("/n/sub:/right")
/// });
/// # let _ = (both, either);
/// ```
#[derive(Default)]
#[non_exhaustive]
pub enum Trigger {
    /// At least one handle has something to do.
    #[default]
    Any,
    /// Every handle has something to do. Handles that have stopped or were removed do not count.
    All,
    /// The handle of this id has something to do; it must be one of the worker's.
    One(String),
    /// Nothing: a round begins at every tick of [`WorkerBuilder::every`](crate::WorkerBuilder::every),
    /// which it needs.
    Always,
    /// What the function says. It is called on the worker with at least one handle ready. If it
    /// panics, that is an [`Event::CallbackPanicked`] of `worker/trigger`, and no round begins any more.
    Custom(Box<dyn FnMut(&HandleStates<'_>) -> bool + Send>),
}

impl Trigger {
    /// The handle of this id has something to do.
    pub fn one(id: impl Into<String>) -> Self {
        Self::One(id.into())
    }

    /// What `condition` says.
    pub fn custom(condition: impl FnMut(&HandleStates<'_>) -> bool + Send + 'static) -> Self {
        Self::Custom(Box::new(condition))
    }
}

impl fmt::Debug for Trigger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Any => f.write_str("Any"),
            Self::All => f.write_str("All"),
            Self::One(id) => write!(f, "One({id:?})"),
            Self::Always => f.write_str("Always"),
            Self::Custom(_) => f.write_str("Custom"),
        }
    }
}

/// Which handles of a worker have something to do, for a custom [`Trigger`].
pub struct HandleStates<'a>(pub(crate) &'a [HandleEntry]);

impl HandleStates<'_> {
    /// The handles in the order in which they run: id, and whether it has something to do.
    pub fn iter(&self) -> impl Iterator<Item = (&str, bool)> + '_ {
        self.0.iter().map(|e| (e.shared.id.as_str(), e.ready))
    }

    /// Whether the handle of this id has something to do.
    #[must_use]
    pub fn is_ready(&self, id: &str) -> bool {
        self.iter().any(|(other, ready)| ready && other == id)
    }

    /// How many handles have something to do.
    #[must_use]
    pub fn ready(&self) -> usize {
        self.0.iter().filter(|e| e.ready).count()
    }
}

/// When the callbacks of a round get their input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Semantics {
    /// Each just before it runs: it sees what came while earlier ones ran.
    #[default]
    TakeThenExecute,
    /// All at the start of the round: each sees the world as it was then (Logical Execution Time).
    LogicalExecutionTime,
}

/// What a worker was told.
#[derive(Default)]
pub(crate) struct Rules {
    pub(crate) trigger: Trigger,
    pub(crate) semantics: Semantics,
    /// Callbacks of one handle per round, at least 1; 1 if not said.
    pub(crate) batch: Option<u32>,
    /// Rounds come by the clock alone.
    pub(crate) every: Option<Every>,
    /// What becomes of those rounds.
    #[cfg(feature = "texts")]
    pub(crate) beat: Option<Arc<RoundCounters>>,
    /// Samples and bytes of the output barrier.
    pub(crate) barrier: Option<(usize, usize)>,
    /// The most handles, those added later included.
    pub(crate) capacity: Option<usize>,
    /// It was said how a handle is treated before there was one.
    pub(crate) early: bool,
    /// How rounds go by these rules, if there are any.
    pub(crate) rounds: Option<&'static Rounds>,
}

impl Rules {
    /// All input is taken when the round begins.
    pub(crate) fn takes_first(&self) -> bool {
        self.semantics == Semantics::LogicalExecutionTime
    }
}

/// What happens when a callback ends after its deadline. It is always counted.
#[derive(Default)]
#[non_exhaustive]
pub enum OnMiss {
    /// Nothing else.
    #[default]
    Count,
    /// The next input of the handle is taken and left out, so that it can catch up.
    SkipNext,
    /// The executor stops.
    Stop,
    /// This is called, on the worker.
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
    /// How long after the deadline the callback ended.
    pub lateness: Nanos,
    /// How many deadlines this handle has missed by now.
    pub count: u64,
}

/// How one handle is treated; see [`WorkerBuilder::options`](crate::WorkerBuilder::options), behind the handle.
///
/// ```
/// use replenish::{HandleOptions, OnMiss};
/// use std::time::Duration;
/// let strict = HandleOptions::new()
///     .priority(3)
///     .deadline(Duration::from_millis(5), OnMiss::SkipNext)
///     .on_error(|event| eprintln!("{event}"));
/// # let _ = strict;
/// ```
#[derive(Default)]
pub struct HandleOptions {
    pub(crate) priority: u8,
    pub(crate) deadline: Option<Deadline>,
    pub(crate) on_miss: OnMiss,
    /// The rules it needs, if its callback runs in every round.
    pub(crate) always: Option<&'static Rounds>,
    pub(crate) group: Option<Group>,
    pub(crate) hook: Option<crate::executor::handles::handle::ErrorHook>,
}

impl HandleOptions {
    /// As handles are treated without it.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// In each round, handles of higher priority come first; those of equal priority (0 where none
    /// is given) in the order they were added. This is the order within one thread, not the
    /// thread's priority.
    #[must_use]
    pub fn priority(self, priority: u8) -> Self {
        Self { priority, ..self }
    }

    /// From release to the end of the callback: time in queues, preemption and execution all count.
    /// Timers have their period, other handles none, unless given.
    #[must_use]
    pub fn deadline(self, deadline: Duration, on_miss: OnMiss) -> Self {
        Self {
            deadline: Some(Deadline::of(nanos(deadline))),
            on_miss,
            ..self
        }
    }

    /// What happens when a timer's callback ends after the next release, or a given deadline.
    #[must_use]
    pub fn on_miss(self, on_miss: OnMiss) -> Self {
        Self { on_miss, ..self }
    }

    /// The callback never runs at the same time as another callback of this group, on whatever
    /// worker.
    #[must_use]
    pub fn group(self, group: &Group) -> Self {
        Self {
            group: Some(group.clone()),
            ..self
        }
    }

    /// What of it several handles that belong together have in common.
    pub(crate) fn shared(&self) -> Self {
        Self {
            priority: self.priority,
            group: self.group.clone(),
            hook: self.hook.clone(),
            ..Self::new()
        }
    }

    /// The callback runs in every round of its worker, without input if there is none: for
    /// [`subscribe_always`](crate::WorkerBuilder::subscribe_always), which sets it.
    pub(crate) fn always(self) -> Self {
        Self {
            always: Some(&BY_RULES),
            ..self
        }
    }

    /// Called for everything that goes wrong with the handle: a callback's error, a sample that
    /// does not fit or cannot be decoded, a reply that could not be sent. On the thread it happens
    /// on, each time; it must not block. The executor's own hook gets the same, but rarely.
    #[must_use]
    pub fn on_error(self, hook: impl Fn(&Event<'_>) + Send + Sync + 'static) -> Self {
        Self {
            hook: Some((Box::new(hook) as Box<dyn Fn(&Event<'_>) + Send + Sync>).into()),
            ..self
        }
    }
}

impl fmt::Debug for HandleOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("HandleOptions")
            .field("priority", &self.priority)
            .field("deadline", &self.deadline)
            .field("on_miss", &self.on_miss)
            .field("group", &self.group)
            .finish_non_exhaustive()
    }
}
