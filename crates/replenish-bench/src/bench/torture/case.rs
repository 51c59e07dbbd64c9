//! A case: one executor, its neighbours, and the disturbances, as data that replays.

use crate::load::Nanos;
use serde::{Deserialize, Serialize};
use std::fmt;

/// A program to torture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Case {
    /// The seed that it comes from.
    pub seed: u64,
    /// Whether the enforcer may read context-switch records.
    pub records: bool,
    /// The budgeted workers.
    pub workers: Vec<Worker>,
    /// Threads that belong to no executor.
    pub strangers: Vec<Stranger>,
    /// Stops of the whole process.
    pub stops: Vec<Stop>,
    /// A handle comes and goes so often; 0: none does.
    pub churn_every: Nanos,
    /// So long after the start the program may raise no thread any more.
    #[serde(default)]
    pub drops_at: Option<Nanos>,
    /// The executor pins no worker, and so no enforcer. The program may use the CPU under test
    /// only, where the judge looks.
    #[serde(default)]
    pub unpinned: bool,
}

/// A budgeted worker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Worker {
    /// Its FIFO priority while it has budget.
    pub priority: u8,
    /// Its background priority; `None`: suspended without budget.
    pub background: Option<u8>,
    pub budget: Nanos,
    pub period: Nanos,
    pub max_repl: u16,
    pub work: Work,
    /// The group that its callbacks share.
    pub group: Option<u8>,
    /// A second handle panics once.
    pub panics: bool,
    /// The executor chooses its priorities, and tests whether it can keep the promise.
    #[serde(default)]
    pub guaranteed: bool,
    /// Its work is a future that awaits sleeps and writes lines to the log: of a timer or a sleepy
    /// worker without a group.
    #[serde(default)]
    pub awaits: bool,
}

/// The work of a worker's callbacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Work {
    /// One callback that never ends and never waits.
    Endless,
    /// Callbacks back to back, each of so much CPU time.
    BackToBack { burn: Nanos },
    /// A timer of this period, and so much CPU time each.
    Periodic { every: Nanos, burn: Nanos },
    /// One callback that burns and sleeps in turn.
    Sleepy { burn: Nanos, sleep: Nanos },
    /// A message every so often, and so much CPU time for each.
    Messages { every: Nanos, burn: Nanos },
}

/// A FIFO thread of the same process on the same CPU that the executor does not know.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Stranger {
    pub priority: u8,
    pub burn: Nanos,
    pub sleep: Nanos,
}

/// The whole process is stopped, and continues.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Stop {
    /// After the start.
    pub at: Nanos,
    pub lasts: Nanos,
}

impl Worker {
    /// It always wants the CPU, and nothing in its callbacks waits.
    pub(super) fn is_hungry(&self) -> bool {
        matches!(self.work, Work::Endless) && self.group.is_none() && !self.panics
    }

    /// The longest time it holds its group for; `None`: without end.
    pub(super) fn section(&self) -> Option<Nanos> {
        match self.work {
            _ if self.group.is_none() => Some(0),
            Work::Endless | Work::Sleepy { .. } => None,
            Work::BackToBack { burn }
            | Work::Periodic { burn, .. }
            | Work::Messages { burn, .. } => Some(burn),
        }
    }
}

impl Case {
    /// The workers that wait nowhere but before their callbacks, and while they are suspended: they
    /// read their CPU clock as soon as they have left a wait. Others go on from the middle of a
    /// callback.
    pub(super) fn prompt(&self) -> Vec<String> {
        let waits_inside = |w: &Worker| {
            let work = matches!(w.work, Work::Periodic { .. } | Work::Messages { .. });
            w.group.is_some() || !work || !self.stops.is_empty()
        };
        let all = self.workers.iter().enumerate();
        let prompt = all.filter(|(_, worker)| !waits_inside(worker));
        prompt.map(|(index, _)| name(index)).collect()
    }

    /// The most that a worker may have at a priority that it inherits, beyond its budget, since it
    /// was lowered last. One that is suspended finishes its section; one with a background priority
    /// may go on until it has inherited as much as its budget, and so may one whose raise is
    /// refused, for want of privileges: it is let go all the same. `None`: the section has no end,
    /// and its group waits for it.
    pub(super) fn inherits(&self, worker: &Worker) -> Option<Nanos> {
        let shares = |other: &&Worker| other.group == worker.group;
        if worker.group.is_none() || self.workers.iter().filter(shares).count() < 2 {
            return Some(0); // nobody waits for it
        }
        let goes_on = if worker.background.is_some() || self.drops_at.is_some() {
            worker.budget
        } else {
            0
        };
        worker.section().map(|section| goes_on + section)
    }
}

/// A worker's name, which is also its thread's.
pub(super) fn name(index: usize) -> String {
    format!("w{index}")
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let load: f64 = self.workers.iter().map(|w| ratio(w.budget, w.period)).sum();
        write!(
            f,
            "{} workers, {:.0} % promised",
            self.workers.len(),
            load * 100.0
        )?;
        let mut add = |count: usize, what: &str| match count {
            0 => Ok(()),
            n => write!(f, ", {n} {what}"),
        };
        let count = |which: fn(&Worker) -> bool| self.workers.iter().filter(|w| which(w)).count();
        add(count(Worker::is_hungry), "endless")?;
        add(count(|w| w.background.is_none()), "suspended")?;
        add(count(|w| w.group.is_some()), "in groups")?;
        add(count(|w| w.section().is_none()), "endless in groups")?;
        add(count(|w| w.panics), "that panic")?;
        add(count(|w| w.guaranteed), "guaranteed")?;
        add(count(|w| w.awaits), "that await and log")?;
        add(self.strangers.len(), "strangers")?;
        add(self.stops.len(), "stops")?;
        add(
            usize::from(self.churn_every > 0),
            "handle that comes and goes",
        )?;
        add(usize::from(self.drops_at.is_some()), "privilege dropped")?;
        add(usize::from(self.unpinned), "CPU for unpinned threads")?;
        add(usize::from(!self.records), "without switch records")
    }
}

pub(super) fn ratio(part: Nanos, of: Nanos) -> f64 {
    part as f64 / of.max(1) as f64
}
