//! What is asked of the planner: workers, the executor, and what others were promised.

use crate::{Guarantee, Machine, Nanos};
use replenish_sim::analysis::{Demand, Section};
use sporadic::Policy;

/// Everything a plan depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// What there is to give.
    pub machine: Machine,
    /// The workers, with unique names.
    pub workers: Vec<Worker>,
    /// The executor's own thread.
    pub executor: ExecutorRequest,
    /// What runs on these CPUs already and cannot be changed.
    pub promised: Vec<Promise>,
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
    /// How it wants to be scheduled.
    pub scheduling: Requirement,
    /// The only CPU it may use; `None`: a guaranteed worker goes where the plan puts it, others
    /// may run on any.
    pub cpu: Option<usize>,
    /// What it is known to do, if anything is; a rate guarantee says it already.
    pub demand: Option<Demand>,
    /// The locks each callback takes, shared with workers of the same CPU.
    pub sections: Vec<Section>,
    /// By when its callbacks must end, for workers whose demand is known. Ignored beside a
    /// guarantee, which has its own.
    pub deadline: Option<Nanos>,
    /// Of a worker that others release: how late in relation to a strict pattern that can be, in
    /// ns. Unlike jitter it does not count as response: deadlines run from the release itself.
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
            sections: Vec::new(),
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

    pub(crate) fn guarantee(&self) -> Option<&Guarantee> {
        match &self.scheduling {
            Requirement::Guarantee(guarantee) => Some(guarantee),
            Requirement::Policy(_) => None,
        }
    }
}

/// How a worker wants to be scheduled.
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
        /// How it is scheduled.
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
    /// How it is scheduled.
    pub policy: Policy,
    /// What it does, if known.
    pub demand: Option<Demand>,
    /// By when its budget must be delivered (and its jobs must end), in ns; `None`: it was promised
    /// nothing.
    pub deadline: Option<Nanos>,
}
