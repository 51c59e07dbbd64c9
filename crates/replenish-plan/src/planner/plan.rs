//! A plan: what every thread of a request gets, and why.

use super::neighbours::percent;
use crate::Nanos;
use sporadic::Policy;
use std::fmt;

/// A schedule in which every guarantee holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The workers, in the order of the request.
    pub workers: Vec<PlannedWorker>,
    /// The executor's own thread, if it has something to do.
    pub executor: Option<PlannedExecutor>,
    /// The enforcers' priority, one on each CPU with budgets.
    pub enforcer_priority: u8,
    /// The CPUs of the request.
    pub cpus: Vec<CpuLoad>,
    /// The chains of a deployment file.
    pub chains: Vec<PlannedChain>,
    /// Limits of these guarantees, in sentences.
    pub warnings: Vec<String>,
}

/// One worker.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedWorker {
    /// Its name.
    pub name: String,
    /// Its CPU; `None`: any.
    pub cpu: Option<usize>,
    /// The chosen or given policy.
    pub policy: Policy,
    /// The granted part of the guarantee, in ns: of a rate, CPU time per callback; otherwise the
    /// budget.
    pub amount: Option<Nanos>,
    /// Deadline after the release, in ns.
    pub deadline: Option<Nanos>,
    /// The longest time until a callback of the known demand ends or, where the demand is not
    /// known, until budget that is due is delivered, in ns. `None`: no bound.
    pub worst_response: Option<Nanos>,
    /// Reasons for the choices, a sentence each.
    pub reasons: Vec<String>,
}

impl PlannedWorker {
    /// Its real-time priority while it has budget; 0 without one.
    #[must_use]
    pub fn priority(&self) -> u8 {
        self.policy.priority().unwrap_or(0)
    }

    /// Time from the worst response to the deadline, in ns.
    #[must_use]
    pub fn slack(&self) -> Option<Nanos> {
        self.deadline?.checked_sub(self.worst_response?)
    }
}

/// The executor's own thread.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedExecutor {
    /// Its CPU; `None`: any.
    pub cpu: Option<usize>,
    /// Its scheduling.
    pub policy: Policy,
    /// The longest time until budget that is due is delivered, in ns.
    pub worst_response: Option<Nanos>,
    /// Why.
    pub reasons: Vec<String>,
}

/// A chain of workers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlannedChain {
    /// Its name.
    pub name: String,
    /// The longest time from the first release to the end of the last callback, in ns; `None`: no
    /// bound.
    pub worst: Option<Nanos>,
    /// The allowed time, in ns.
    pub deadline: Option<Nanos>,
}

/// The reserved part of a CPU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CpuLoad {
    /// Its number.
    pub cpu: usize,
    /// The share that is reserved, 0 to 1, other programs and enforcement included.
    pub reserved: f64,
    /// The share that may be.
    pub allowed: f64,
}

impl fmt::Display for CpuLoad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "CPU {}: {} reserved, {:.0} % can be.",
            self.cpu,
            percent(self.reserved),
            self.allowed * 100.0
        )
    }
}
