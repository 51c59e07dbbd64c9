//! The planner's request: workers, the executor, and the promises to others.

use crate::{Guarantee, Machine, Nanos};
use replenish_sim::analysis::{Demand, Section};
use sporadic::Policy;

/// Everything a plan depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// The CPUs and costs to plan with.
    pub machine: Machine,
    /// The workers, with unique names.
    pub workers: Vec<Worker>,
    /// The executor's own thread.
    pub executor: ExecutorRequest,
    /// Threads that run on these CPUs already and cannot be changed.
    pub promised: Vec<Promise>,
    /// The names of the locks that workers hold: groups of handles, locks of a deployment file. At
    /// most 4096.
    pub locks: Vec<String>,
}

impl Request {
    /// No workers yet.
    #[must_use]
    pub fn new(machine: Machine) -> Self {
        Self {
            machine,
            workers: Vec::new(),
            executor: ExecutorRequest::Planned { cpu: None },
            promised: Vec::new(),
            locks: Vec::new(),
        }
    }

    /// Appends a worker.
    #[must_use]
    pub fn worker(mut self, worker: Worker) -> Self {
        self.workers.push(worker);
        self
    }
}

/// One worker.
#[derive(Debug, Clone, PartialEq)]
pub struct Worker {
    /// Its name.
    pub name: String,
    /// The requested scheduling.
    pub scheduling: Requirement,
    /// The only CPU it may use; `None`: a guaranteed worker goes where the plan puts it, others
    /// may run on any.
    pub cpu: Option<usize>,
    /// Its demand, if it is known; a rate guarantee states it already.
    pub demand: Option<Demand>,
    /// The locks its callbacks hold.
    pub holds: Vec<Hold>,
    /// Time after the release by which its callbacks must end, for workers whose demand is known.
    /// Ignored beside a guarantee, which has its own.
    pub deadline: Option<Nanos>,
    /// The largest delay against a strict pattern of a worker that others release, in ns. Unlike
    /// jitter it does not count as response: deadlines run from the release itself.
    pub late: Nanos,
}

impl Worker {
    /// A worker with a guarantee, on the CPU that suits best.
    #[must_use]
    pub fn guaranteed(name: impl Into<String>, guarantee: Guarantee) -> Self {
        Self::new(name, Requirement::Guarantee(guarantee))
    }

    /// A worker with a policy of its user's making.
    #[must_use]
    pub fn with_policy(name: impl Into<String>, policy: Policy) -> Self {
        Self::new(name, Requirement::Policy(policy))
    }

    fn new(name: impl Into<String>, scheduling: Requirement) -> Self {
        Self {
            name: name.into(),
            scheduling,
            cpu: None,
            demand: None,
            holds: Vec::new(),
            deadline: None,
            late: 0,
        }
    }

    /// Sets the CPU.
    #[must_use]
    pub fn on(mut self, cpu: usize) -> Self {
        self.cpu = Some(cpu);
        self
    }

    /// Says what it does.
    #[must_use]
    pub fn doing(mut self, demand: Demand) -> Self {
        self.demand = Some(demand);
        self
    }

    /// Adds a lock that callbacks hold; several are held one after another.
    #[must_use]
    pub fn holding(mut self, hold: Hold) -> Self {
        self.holds.push(hold);
        self
    }

    pub(crate) fn guarantee(&self) -> Option<&Guarantee> {
        match &self.scheduling {
            Requirement::Guarantee(guarantee) => Some(guarantee),
            Requirement::Policy(_) => None,
        }
    }
}

/// A lock that a callback holds: of a group's handle from its beginning to its end.
///
/// A guaranteed worker waits for the others that hold the lock, each of which inherits its priority
/// meanwhile. So every worker that shares a lock with a guaranteed one must state its length, and
/// must be on the same CPU.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hold {
    /// Place of the lock in [`Request::locks`].
    pub lock: usize,
    /// The longest time for which one callback holds it, in ns: CPU time, and what it blocks
    /// meanwhile. `None`: not stated; then it is the amount of a rate guarantee, and otherwise
    /// unknown.
    pub length: Option<Nanos>,
    /// The handle whose callback it is, for messages; empty: not known.
    pub handle: String,
}

impl Hold {
    /// A callback of `handle` holds `lock` for at most `length`.
    #[must_use]
    pub fn of(lock: usize, length: Option<Nanos>, handle: impl Into<String>) -> Self {
        Self {
            lock,
            length,
            handle: handle.into(),
        }
    }
}

/// Requested scheduling of a worker.
#[derive(Debug, Clone, PartialEq)]
pub enum Requirement {
    /// The planner chooses.
    Guarantee(Guarantee),
    /// An expert has chosen; the planner takes it into account and leaves it alone.
    Policy(Policy),
}

/// The executor's own thread, which takes messages and hands them to workers.
#[derive(Debug, Clone, PartialEq)]
pub enum ExecutorRequest {
    /// There is none, or it has nothing to do (no subscriptions).
    None,
    /// The planner chooses its budget, priority and CPU.
    Planned {
        /// The only CPU it may use.
        cpu: Option<usize>,
    },
    /// An expert has chosen.
    Policy {
        /// Its scheduling.
        policy: Policy,
        /// The only CPU it may use; `None`: any, so that it delays on each.
        cpu: Option<usize>,
    },
}

/// A thread of another program, which runs already: its place is taken, and what it was promised
/// must hold.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Promise {
    /// Whose, for messages: program, process, worker.
    pub owner: String,
    /// Its CPU; `None`: any of them.
    pub cpu: Option<usize>,
    /// Its scheduling.
    pub policy: Policy,
    /// Its demand, if known.
    pub demand: Option<Demand>,
    /// The locks that its callbacks share with others of its program. Their numbers follow those of
    /// [`Request::locks`]; no two programs share one.
    pub sections: Vec<Section>,
    /// Time by which its budget must be delivered (and its jobs must end), in ns; `None`: it was
    /// promised nothing.
    pub deadline: Option<Nanos>,
}

impl Promise {
    /// The first number that no lock has yet, behind the `locks` of the request itself: for
    /// [`sections`](Self::sections) of one more program.
    #[must_use]
    pub fn next_lock(locks: usize, promised: &[Self]) -> usize {
        let promised = promised.iter().flat_map(|p| &p.sections);
        let next = promised.map(|s| s.lock + 1).max().unwrap_or(0);
        next.max(locks)
    }
}
