//! CPU time that budgets and threads have used, for a reader.

use crate::{Level, Nanos, Tid};
use std::sync::Arc;

/// A budget of one [`Enforcer`](super::Enforcer).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct BudgetId(pub(super) usize);

/// A budget so far; times in nanoseconds of CPU time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BudgetUsage {
    /// Used at its priority, by all threads together.
    pub high: Nanos,
    /// Used in the background.
    pub background: Nanos,
    /// Number of times that it ran out.
    pub exhaustions: u64,
    /// Number of times that a replenishment raised its threads.
    pub replenishments: u64,
    /// Number of times that the kernel refused to raise or lower one of its threads.
    pub refused: u64,
    /// Level of its threads.
    pub level: Level,
    /// Threads enrolled at this moment.
    pub threads: usize,
    /// Whether blocking is seen in the kernel's records, for all of them.
    pub sees_blocking: bool,
}

/// One thread so far; times in nanoseconds of CPU time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ThreadUsage {
    /// Its process.
    pub pid: Tid,
    /// Its number.
    pub tid: Tid,
    /// Its name when it was enrolled.
    pub name: String,
    /// Its budget.
    pub budget: BudgetId,
    /// Used at the budget's priority.
    pub high: Nanos,
    /// Used in the background.
    pub background: Nanos,
}

/// A [`ThreadUsage`] as it is copied under the enforcer's lock, where nothing allocates.
#[derive(Debug)]
pub(super) struct Figures {
    pub(super) name: Arc<str>,
    pub(super) pid: Tid,
    pub(super) tid: Tid,
    pub(super) budget: BudgetId,
    pub(super) high: Nanos,
    pub(super) background: Nanos,
}

impl From<Figures> for ThreadUsage {
    fn from(of: Figures) -> Self {
        Self {
            pid: of.pid,
            tid: of.tid,
            name: of.name.to_string(),
            budget: of.budget,
            high: of.high,
            background: of.background,
        }
    }
}

/// The findings of an [`Enforcer::inspect`](super::Enforcer::inspect).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Inspection {
    /// Threads that have ended since the last one, with their last figures.
    pub ended: Vec<ThreadUsage>,
    /// Threads that had another policy or CPU than they were given; they have it again.
    pub displaced: u64,
}
