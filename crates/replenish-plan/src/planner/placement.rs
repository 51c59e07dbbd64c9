//! One thread of a request: its parameters are the planner's to choose, or given.

use crate::Nanos;
use replenish_sim::analysis::{Demand, Section};
use sporadic::{Low, Policy};

/// Wake-ups per period assumed for a worker whose demand is unknown, and its number of
/// replenishments. More replenishments make bounds worse and help few.
pub(super) const PIECES: u16 = 16;

/// A thread whose parameters we choose.
#[derive(Debug, Clone)]
pub(super) struct ThreadPlan {
    pub(super) period: Nanos,
    pub(super) deadline: Nanos,
    /// One job per period that takes the amount; otherwise the amount is the budget.
    pub(super) per_job: bool,
    pub(super) importance: u8,
    pub(super) suspend: bool,
    /// Given for all threads of jobs; the cost is the amount then.
    pub(super) demand: Option<Demand>,
    /// Its callbacks are stated to wait, for something else than their CPU.
    pub(super) waits: bool,
    /// The part of the demand's jitter before the release that the deadline runs from, in ns.
    pub(super) late: Nanos,
    pub(super) sections: Vec<Section>,
    /// The executor's: above all workers.
    pub(super) level: Option<u8>,
    pub(super) cpu: Option<usize>,
    /// It shares locks, and goes to the CPU of the others of this number.
    pub(super) together: Option<usize>,
}

impl ThreadPlan {
    /// The share of a CPU, roughly: for placing.
    pub(super) fn share(&self, amount: Nanos) -> f64 {
        amount as f64 / self.period.max(1) as f64
    }
}

/// A thread whose parameters are given.
#[derive(Debug, Clone)]
pub(super) struct FixedThread {
    pub(super) policy: Policy,
    pub(super) demand: Option<Demand>,
    pub(super) sections: Vec<Section>,
    pub(super) deadline: Option<Nanos>,
    /// Its budget is held by this program's enforcer.
    pub(super) own: bool,
}

impl FixedThread {
    pub(super) fn priority(&self) -> u8 {
        match &self.policy {
            Policy::Deadline { .. } => u8::MAX,
            policy => policy.priority().unwrap_or(0),
        }
    }

    /// Whether it may take the CPU from a thread at `level` for ever.
    pub(super) fn is_unlimited_above(&self, level: u8) -> bool {
        match &self.policy {
            Policy::Other | Policy::Deadline { .. } => false,
            Policy::Fifo { priority } | Policy::RoundRobin { priority } => {
                *priority >= level && self.demand.is_none()
            }
            Policy::Sporadic(params) | Policy::KernelSporadic(params) => {
                self.demand.is_none()
                    && matches!(params.low(), Low::Background(low) if low >= level)
            }
        }
    }
}
