//! Options of one handle: its place in a round, deadline, group and error hook.

use super::deadline::{Deadline, OnMiss};
use super::group::Group;
use super::state::ErrorHook;
use crate::event::{Event, Events};
use crate::executor::wake::schedule::nanos;
use crate::sync::Arc;
use core::fmt;
use core::time::Duration;

/// Options of one handle; see [`WorkerBuilder::options`](crate::WorkerBuilder::options).
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
    /// Its callback runs in every round.
    pub(crate) always: bool,
    pub(crate) group: Option<Group>,
    pub(crate) hook: Option<ErrorHook>,
}

impl HandleOptions {
    /// The options that handles have by default.
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

    /// Sets the deadline from release to the end of the callback, of any length (with zero, every
    /// callback misses it): time in queues, preemption and execution all count. Default: a timer's
    /// period; none for other handles.
    ///
    /// Of a callback that gives a future each poll is judged alone, and not the future as a whole:
    /// the first one from the release, later ones from where they begin. A timer's period holds for
    /// the first one only.
    #[must_use]
    pub fn deadline(self, deadline: Duration, on_miss: OnMiss) -> Self {
        Self {
            deadline: Some(Deadline::of(nanos(deadline))),
            on_miss,
            ..self
        }
    }

    /// The rule for a timer's callback that ends after the next release, or a given deadline.
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

    /// The options that several handles added together have in common.
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
            always: true,
            ..self
        }
    }

    /// Called for everything that goes wrong with the handle: a callback's error, a sample that
    /// does not fit or cannot be decoded, a reply that could not be sent. On the thread it happens
    /// on, each time; it must not block. The executor's own hook gets the same, but rarely.
    #[must_use]
    pub fn on_error(self, hook: impl Fn(&Event<'_>) + Send + Sync + 'static) -> Self {
        Self {
            hook: Some(Arc::new(Events::new(hook))),
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
