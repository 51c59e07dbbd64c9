//! Rules for a worker's rounds: the trigger that starts a round, the input that it takes, and the
//! reaction to a missed deadline.

use crate::executor::handles::entry::HandleEntry;
use alloc::boxed::Box;
use alloc::string::String;
use core::fmt;

/// The condition for a worker to begin a round. It is checked when something new has come
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
    /// No input is needed: a round begins at every tick of
    /// [`WorkerBuilder::every`](crate::WorkerBuilder::every), which this trigger requires; without
    /// threads ([`Executor::local`](crate::Executor::local)) whenever the program spins.
    Always,
    /// The function decides. It is called on the worker with at least one handle ready. If it
    /// panics, that is an [`Event::CallbackPanicked`](crate::Event::CallbackPanicked) of
    /// `worker/trigger`, and no round begins any more.
    Custom(Box<dyn FnMut(&HandleStates<'_>) -> bool + Send>),
}

impl Trigger {
    /// The handle of this id has something to do.
    pub fn one(id: impl Into<String>) -> Self {
        Self::One(id.into())
    }

    /// The function `condition` decides.
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

/// The handles of a worker, and whether each has input, for a custom [`Trigger`].
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

    /// Number of handles that have input.
    #[must_use]
    pub fn ready(&self) -> usize {
        self.0.iter().filter(|e| e.ready).count()
    }
}

/// The time at which the callbacks of a round get their input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Semantics {
    /// Each just before it runs: it sees what came while earlier ones ran.
    #[default]
    TakeThenExecute,
    /// All at the start of the round: each sees the world as it was then (Logical Execution Time).
    LogicalExecutionTime,
}
